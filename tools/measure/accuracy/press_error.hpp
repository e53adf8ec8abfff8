// Force on a hand that presses onto a fused surface, against the spring of the true solid: what
// fusion, window and proxy make of it, by the product's own code.
//
// The hand comes from `off_m` outside along the true normal, goes `depth_m` into the true solid,
// and stays `hold_s`. Right would be K * (its depth in the true solid) along the true normal. The
// error is the length of the difference of the two forces in the last tick. A surface that is not
// there gives no force, and the whole K * depth as error.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/world/world.hpp"
#include "perception/geometry/pose.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {

struct PressOptions {
  int places = 100;  // at most, of those given
  std::uint64_t seed = 1;
  double off_m = 0.03, depth_m = 0.004, speed_m_per_s = 0.1, hold_s = 0.3;
  double stiffness_N_per_m = 1000;
  double voxel_m = 0.01, truncation_m = 0.05;  // of the map
};

// Presses at places of the true surface, drawn by the seed, over which `off_m` of space is free.
// `map`: a task that has seen its images; X_WM: its frame in the world's. Error of each place, N.
[[nodiscard]] std::vector<double> press_errors_N(FusionFeed& map, const perception::Pose& X_WM,
                                                 const drivers::World& world,
                                                 std::span<const perception::Vec3> surface_W,
                                                 const PressOptions& options);

}  // namespace teletact
