// Is the force that of a spring from the hand to the surface? Checked against the map itself, by a march
// that shares nothing with the renderer: from the hand along the map's own normal to the field's zero
// set. A proxy that slid aside pulls with more than K times that depth.
#pragma once

#include <vector>

#include "perception/tsdf/tsdf_map.hpp"
#include "tasks/graph/samples.hpp"

namespace teletact {

struct ForceCheck {
  double relative_error_p95 =
      -1;  // |F - K depth / scale| / (K depth / scale); -1: nothing to check
  std::size_t samples = 0;
};

// Only samples that press on a plane: one active constraint, normals within 10 degrees 30 mm around,
// at least 1 N, full gain, no guard at work, hand moving below 5 mm/s in the scene. `stiffness_N_per_m` is at the device, `scale` scene
// metres per hand metre. The map is that of the end of the run, so it must not have changed since.
[[nodiscard]] ForceCheck check_force(const perception::TsdfMap& map,
                                     const std::vector<tasks::HapticSample>& samples,
                                     double stiffness_N_per_m, double scale);

}  // namespace teletact
