// Halls with boxes in them, a camera that turns in their midst, and what the tests of lost cameras
// and of stored maps have in common.
#pragma once

#include <cmath>
#include <numbers>

#include "tests/unit/tasks_fusion/rig.hpp"

namespace tests {

// Floor and four walls at +-half_x and +-half_y.
inline AnalyticScene empty_hall(double half_x, double half_y) {
  AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
              {Vec3(half_x, 0, 0), -Vec3::UnitX()},
              {Vec3(-half_x, 0, 0), Vec3::UnitX()},
              {Vec3(0, half_y, 0), -Vec3::UnitY()},
              {Vec3(0, -half_y, 0), Vec3::UnitY()}};
  return s;
}

// `centre`, `size`: of the box; turned by yaw about its upright axis.
inline void add_box(AnalyticScene& s, const Vec3& centre, const Vec3& size, double yaw) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(yaw, Vec3::UnitZ()).toRotationMatrix();
  X.translation() = centre;
  s.boxes.push_back({X, size / 2});
}

// A hall of 6 x 4 m with the same group of furniture in two corners, alike but for one box of each.
inline AnalyticScene hall() {
  AnalyticScene s = empty_hall(3, 2);
  for (const double side : {1.0, -1.0}) {  // the second group is the first, turned by half a turn
    const double turn = side > 0 ? 0 : std::numbers::pi;
    add_box(s, Vec3(2.2 * side, 1.2 * side, 0.35), Vec3(0.5, 0.4, 0.7), 0.4 + turn);
    add_box(s, Vec3(1.5 * side, 1.5 * side, 0.2), Vec3(0.3, 0.3, 0.4), 0.9 + turn);
    add_box(s, Vec3(2.5 * side, 0.2 * side, 0.5), Vec3(0.4, 0.5, 1.0), -0.3 + turn);
  }
  add_box(s, Vec3(1.6, 0.6, 0.15), Vec3(0.25, 0.25, 0.3), 0.2);  // in one corner
  // In the other: elsewhere, of another size.
  add_box(s, Vec3(-1.75, -0.75, 0.2), Vec3(0.2, 0.3, 0.4), -0.5);
  add_box(s, Vec3(0.6, -1.5, 0.3), Vec3(0.5, 0.3, 0.6), 0.7);
  add_box(s, Vec3(-0.3, 1.5, 0.25), Vec3(0.5, 0.3, 0.5), -0.6);
  return s;
}

// A camera 1 m above the floor.
inline Pose in_hall(double yaw, double x = 0, double y = 0, double pitch = -0.35) {
  const Vec3 eye(x, y, 1.0);
  return look_at(eye, eye + Vec3(std::cos(yaw), std::sin(yaw), pitch));
}

// A passage of `length` m with a box every 0.8 m, now left, now right.
inline AnalyticScene passage(double length) {
  AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
              {Vec3(0, 1, 0), -Vec3::UnitY()},
              {Vec3(0, -1, 0), Vec3::UnitY()}};
  for (int n = 0; 0.8 * n < length; ++n)
    add_box(s, Vec3(0.9 + 0.8 * n, n % 2 == 0 ? 0.6 : -0.6, 0.25),
            Vec3(0.4, 0.3, 0.5 + 0.06 * (n % 4)), 0.5 * n);
  return s;
}
// x along it; swaying from frame to frame.
inline Pose in_passage(double x, int frame) {
  return look_at(Vec3(x, 0.1 * std::sin(0.05 * frame), 0.9), Vec3(x + 1.5, 0, 0.2));
}

// One full turn about the middle, on a circle of this radius; every frame is claimed.
inline void tour(Rig& rig, const AnalyticScene& scene, int frames, double radius) {
  for (int i = 0; i < frames; ++i) {
    const double a = 2 * std::numbers::pi * i / frames;
    rig.see(scene, in_hall(a, radius * std::sin(a), radius * (1 - std::cos(a))), 0.0015);
    ASSERT_TRUE(rig.out.camera.claimed) << "frame " << i;
  }
}

inline double off_m(const Rig& rig, const Pose& X_WC) {
  return (rig.out.camera.X_WC.translation() - X_WC.translation()).norm();
}

}  // namespace tests
