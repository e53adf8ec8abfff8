// The spring between hand and proxy in one tick.  Frames: W world, D haptic base.  SI.
#pragma once

#include <cmath>

#include "perception/geometry/pose.hpp"

namespace tasks {

// What pulls at the hand, F = K pull, scene metres.
struct Spring {
  perception::Vec3 pull_W = perception::Vec3::Zero();
  perception::Vec3 elastic_W =
      perception::Vec3::Zero();  // without friction: the slope of the energy
  perception::Vec3 rendered_W = perception::Vec3::Zero();  // proxy with friction
  double length_m = 0;                                     // K length^2 / 2 is that energy
  double friction_m = 0;                                   // of pull_W
  bool contact = false;
};

[[nodiscard]] inline bool finite(const perception::Vec3& v) noexcept {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

// `f`, no longer than `limit`.
[[nodiscard]] inline perception::Vec3 limited(const perception::Vec3& f, double limit) noexcept {
  const double norm = f.norm();
  return norm > limit ? perception::Vec3(f * (limit / norm)) : f;
}

}  // namespace tasks
