// What the parts of the boundary bench stand on: a floor, and the task as they run it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace teletact {

// Solid below z = 0, about the origin; the material by slot_of(x index of the node in W).
template <class Slot>
void fill_floor(perception::SurfacePatch& p, int nodes, const Slot& slot_of) {
  p.voxel_size = 0.01;
  p.metres_per_unit = static_cast<float>(0.05 / 32767.0);
  p.nodes = nodes;
  p.origin_node = {-nodes / 2, -nodes / 2, -nodes / 2};
  const int middle = nodes / 2;
  for (int x = 0; x < nodes; ++x) {
    for (int y = 0; y < nodes; ++y) {
      for (int z = 0; z < nodes; ++z) {
        const std::size_t i = p.index(x, y, z);
        const double d = std::clamp(0.01 * (z - middle), -0.05, 0.05);
        p.distance[i] = static_cast<std::int16_t>(std::lround(d / 0.05 * 32767));
        p.material[i] = static_cast<std::uint8_t>(slot_of(x - middle) + 1);
        p.set_free(i, d > 0);
      }
    }
  }
}

inline tasks::HapticConfig loop_config(double stiffness, bool layer) {
  tasks::HapticConfig c;
  c.stiffness_N_per_m = stiffness;
  c.patch_liveness_s = 1e9;  // the floor does not change
  c.fade_in_s = 0;           // the run begins pressed in
  c.guard = layer;
  c.passivity_controller = false;
  return c;
}

}  // namespace teletact
