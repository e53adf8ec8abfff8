// A hand on a fused table, recorded as a haptic run: presses, slides, a book's side and top, the
// table's edge. The map is the product's own, fused from rendered depth at true poses and cropped
// to a cube of N voxels of 10 mm about the table's corner (64), or about the whole room (512).
// Where the hand is, both hold the same surface, so what differs is the size of the map.
#pragma once

#include <string>
#include <vector>

#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tools/touch/tick_file.hpp"

namespace teletact {

struct TableRun {
  int blocks = 0;  // of 8^3 voxels that the map holds
  double ticks = 0, contact = 0;
};

// Position of the hand in W, one a tick of period_s. `ticks` 0: the whole way, else it is cut
// there.
[[nodiscard]] std::vector<perception::Vec3> table_hand(double period_s, std::size_t ticks = 0);

// Records the run on the map of `edge` voxels (64 to 512) with the default task into an open file.
// Windows are published 30 times a second and follow the hand as fusion's do.
TableRun record_table_run(rt::NonRealtime&, int edge, std::size_t ticks, std::FILE* file);

}  // namespace teletact
