// The chunks round a camera as a dense cube, so that kernels find a block with two loads and no
// hash.
//
// Entry (x, y, z), z fastest, of chunk corner + (x, y, z): where its table of block numbers begins
// in MapView::arrays().tables; the empty table where there is no chunk. A chunk outside the cube is
// not seen: 16 chunks to every side are 10 m at voxels of 1 cm.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/tsdf/blocks/map_view.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class ChunkDirectory {
 public:
  static constexpr int kEdge = 32;

  explicit ChunkDirectory(rt::NonRealtime&)
      : table_(static_cast<std::size_t>(kEdge) * kEdge * kEdge) {}
  // Round the chunk `middle`.
  void fill(const MapView& map, const int (&middle)[3]) noexcept;
  // Chunk (x, y, z), number n of the map, was added since.
  void add(const MapView& map, int x, int y, int z, int n) noexcept;

  [[nodiscard]] const std::int32_t* data() const noexcept { return table_.data(); }
  [[nodiscard]] int corner(int axis) const noexcept { return corner_[axis]; }
  [[nodiscard]] std::size_t memory_bytes() const noexcept {
    return table_.size() * sizeof table_[0];
  }

 private:
  int corner_[3] = {0, 0, 0};
  std::vector<std::int32_t> table_;
};

}  // namespace perception
