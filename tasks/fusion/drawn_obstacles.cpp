#include "tasks/fusion/drawn_obstacles.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::Vec3;
using perception::VirtualObstacle;

DrawnObstacles::DrawnObstacles(const perception::GroundConfig& scene) {
  for (const auto& o : scene.virtual_obstacles) {
    if (count_ == perception::GroundMap::kMaxVirtual) break;
    obstacles_[static_cast<std::size_t>(count_++)] = o.obstacle();
  }
}

bool DrawnObstacles::apply(const SceneEdit& e) noexcept {
  const auto begin = ids_.begin(), end = ids_.begin() + count_;
  if (e.kind == SceneEdit::Kind::kErase) {
    int kept = 0;
    for (int n = 0; n < count_; ++n) {
      const auto from = static_cast<std::size_t>(n), to = static_cast<std::size_t>(kept);
      if (ids_[from] != 0 && (e.id == SceneEdit::kAll || ids_[from] == e.id)) continue;
      ids_[to] = ids_[from];
      obstacles_[to] = obstacles_[from];
      ++kept;
    }
    const bool any = kept < count_;
    count_ = kept;
    return any;
  }
  const bool disc = e.kind == SceneEdit::Kind::kDrawDisc;
  if ((!disc && e.kind != SceneEdit::Kind::kDrawBox) || e.id == 0) return false;
  const auto good = [](double half) { return half > 0 && half <= 100; };  // no number: false
  if (!good(e.half_m[0]) || (!disc && !good(e.half_m[1])) ||
      !std::isfinite(e.centre_W[0] + e.centre_W[1] + e.centre_W[2] + e.yaw_rad))
    return false;
  const auto old = std::find(begin, end, e.id);
  if (old == end && count_ == perception::GroundMap::kMaxVirtual) return false;
  const auto at = static_cast<std::size_t>(old - begin);
  if (old == end) ++count_;
  ids_[at] = e.id;
  VirtualObstacle& o = obstacles_[at];
  o.kind = disc ? VirtualObstacle::Kind::kDisc : VirtualObstacle::Kind::kBox;
  o.centre_W = Vec3(e.centre_W[0], e.centre_W[1], e.centre_W[2]);
  o.half_x_m = e.half_m[0];
  o.half_y_m = e.half_m[1];
  o.yaw_rad = e.yaw_rad;
  o.radius_m = e.half_m[0];
  return true;
}

Eigen::AlignedBox3d box_of(const SceneEdit& e) noexcept {
  const Vec3 centre(e.centre_W[0], e.centre_W[1], e.centre_W[2]);
  const Vec3 half(e.half_m[0], e.half_m[1], e.half_m[2]);
  return {centre - half, centre + half};
}

}  // namespace tasks
