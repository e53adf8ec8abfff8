// What the parts of the planning task share: the ground plane of a map, seen from W, and distances
// on it.
#pragma once

#include <algorithm>
#include <cmath>

#include "tasks/planning/planning_task.hpp"

namespace tasks {

[[nodiscard]] inline Point2 nearest_on_segment(Point2 p, Point2 a, Point2 b) {
  const double dx = b.x - a.x, dy = b.y - a.y, d2 = dx * dx + dy * dy;
  const double t = d2 > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / d2, 0.0, 1.0) : 0.0;
  return {a.x + t * dx, a.y + t * dy};
}

[[nodiscard]] inline double distance_to_segment(Point2 p, Point2 a, Point2 b) {
  return distance(p, nearest_on_segment(p, a, b));
}

[[nodiscard]] inline rt::Health counted(rt::FaultId id) {
  return rt::Health::of(rt::Severity::kCounted, id);
}

// W's vertical must be near the ground's normal, or x and y of W would not name a place on it.
struct PlanningTask::Ground {
  explicit Ground(const perception::CostMap& of) : map(of), X_WM(of.X_WM), X_MW(of.X_WM.inverse()) {
    const auto& R = X_WM.linear();
    usable = map.ground_found && X_WM.matrix().allFinite() && R(2, 2) > 0.8;
  }
  const perception::CostMap& map;
  Pose X_WM, X_MW;
  bool usable = false;

  // Nobody has seen the floor there.
  [[nodiscard]] bool unseen(Point2 p_M) const {
    const double x = std::floor(p_M.x / map.resolution), y = std::floor(p_M.y / map.resolution);
    if (!(x >= 0 && y >= 0 && x < map.width && y < map.height)) return true;
    const auto cell = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                      static_cast<std::size_t>(x);
    return map.cost[cell] == perception::CostMap::kUnknown;
  }
  // The point of the ground above or below (x, y) of W.
  [[nodiscard]] Point2 under(double x_W, double y_W) const {
    const Vec3 n = X_WM.linear().col(2), o = X_WM.translation();
    const double z = o.z() - (n.x() * (x_W - o.x()) + n.y() * (y_W - o.y())) / n.z();
    const Vec3 p = X_MW * Vec3(x_W, y_W, z);
    return {p.x(), p.y()};
  }
  [[nodiscard]] Vec3 to_W(Point2 p_M) const { return X_WM * Vec3(p_M.x, p_M.y, 0.0); }
  // Foot of the perpendicular: what "under the mark" means to the robot.
  [[nodiscard]] Point2 foot(const Vec3& p_W) const {
    const Vec3 p = X_MW * p_W;
    return {p.x(), p.y()};
  }
};

}  // namespace tasks
