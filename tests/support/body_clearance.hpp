// How near the robot's body comes to what stands in the world: brute force over points of its
// surface.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "drivers/world/world.hpp"

namespace tests {

using perception::Vec3;

// Points of the robot's surface at most `step` apart, in B: top, bottom and sides of every box of
// its body.
inline std::vector<Vec3> body_points(double step = 0.01) {
  std::vector<Vec3> out;
  for (const auto& b : drivers::youbot_body()) {
    std::array<int, 3> n{};
    for (int a = 0; a < 3; ++a)
      n[static_cast<std::size_t>(a)] =
          std::max(1, static_cast<int>(std::ceil(2 * b.half[a] / step)));
    for (int i = 0; i <= n[0]; ++i) {
      for (int j = 0; j <= n[1]; ++j) {
        if (i != 0 && i != n[0] && j != 0 && j != n[1])
          continue;  // the sides are what meets a room
        for (int k = 0; k <= n[2]; k += std::max(1, n[2] / 4)) {
          const Vec3 f(2.0 * i / n[0] - 1, 2.0 * j / n[1] - 1, 2.0 * k / n[2] - 1);
          out.push_back(b.centre_B + f.cwiseProduct(b.half));
        }
      }
    }
  }
  return out;
}

// Least distance of the body at a pose to what stands in the world, by brute force over its
// surface.
inline double clearance_m(const drivers::World& world, double x_m, double y_m, double yaw_rad) {
  static const std::vector<Vec3> body = body_points();
  const auto shapes = world.shapes();
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    if (shapes[i].ground) continue;
    // Far shapes need no points: the body lies within 1.2 m of its origin.
    if (world.signed_distance(Vec3(x_m, y_m, 0.5), static_cast<int>(i)) > least + 1.2) continue;
    const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
    for (const Vec3& p : body) {
      const Vec3 w(x_m + c * p.x() - s * p.y(), y_m + s * p.x() + c * p.y(), p.z());
      least = std::min(least, world.signed_distance(w, static_cast<int>(i)));
    }
  }
  return least;
}

}  // namespace tests
