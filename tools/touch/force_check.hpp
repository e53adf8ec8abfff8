// Checks that the force is that of a spring from the hand to the surface. The reference is the map
// itself: a march from the hand along the map's own normal to the zero set of the field. It shares
// no code with the renderer. A proxy that slid aside pulls with more than K times that depth.
#pragma once

#include <optional>
#include <vector>

#include "perception/tsdf/tsdf_map.hpp"
#include "tasks/graph/samples.hpp"

namespace teletact {

struct ForceCheck {
  double relative_error_p95 =
      -1;  // |F - K depth / scale| / (K depth / scale); -1: nothing to check
  std::size_t samples = 0;
};

// Uses only samples that press on a plane: one active constraint, normals within 10 degrees 30 mm
// around, at least 1 N, full gain, no guard active, hand slower than 5 mm/s in the scene.
// `stiffness_N_per_m` is at the device, `scale` is scene metres per hand metre. The map is that of
// the end of the run, so it must not have changed since; samples before `since` do not count.
[[nodiscard]] ForceCheck check_force(const perception::TsdfMap& map,
                                     const std::vector<tasks::HapticSample>& samples,
                                     double stiffness_N_per_m, double scale, rt::Time since = {});

// The same while the map grows: each sample is checked against the map just after it. For callers
// that may read the map between two of its changes.
class ForceChecker {
 public:
  static constexpr std::size_t kMost = 200000;
  ForceChecker(double stiffness_N_per_m, double scale)
      : stiffness_N_per_m_(stiffness_N_per_m), scale_(scale) {}
  // Those of `samples`, which are in order of time, that are newer than the last call's. At most
  // kMost are judged.
  void look(const perception::TsdfMap& map, const std::vector<tasks::HapticSample>& samples);
  [[nodiscard]] ForceCheck result() const;

 private:
  double stiffness_N_per_m_, scale_;
  std::optional<tasks::HapticSample> before_;
  std::vector<double> errors_;
};

}  // namespace teletact
