// teletact bench drift: the fusion task on a scene in which nothing moves, for a long time. Each
// frame has its own noise and is fused at the pose that tracking found, so an error of the pose
// could feed itself.
//
//   worst_mm, worst_deg   largest distance and angle from the true pose over all claimed frames
//   last_mm               the same, mean over the last tenth: a drift shows here
//   first_mm              mean over frames 10 .. N / 10
//   orthonormal           largest |R^T R - 1| of all poses
//
// Limits: every frame claimed, never more than 2 mm off, orthonormal to 1e-9, in the last tenth at
// most 0.3 mm more than in the first (from 200 frames on).
#pragma once

#include <ostream>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct DriftResult {
  int frames = 0, claimed = 0;
  double voxel_mm = 0;
  double worst_mm = 0, worst_deg = 0, first_mm = 0, last_mm = 0;
  double orthonormal = 0;
  double cpu_ms = 0;  // a frame, mean
  // What must hold of a still scene, whatever the number of frames.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// `step`: 1 full size (512 x 424), 2 half size, 4 a quarter.
[[nodiscard]] DriftResult bench_drift(std::ostream& progress, int frames, double voxel_m, int step);

}  // namespace teletact
