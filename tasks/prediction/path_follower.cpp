#include "tasks/prediction/path_follower.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {
namespace {

using perception::Pose2;
using perception::wrap_angle;

// Nearest point of the segment a-b to p: its share of the way and its distance.
struct Foot {
  double f = 0, distance = 0;
};
Foot foot(double px, double py, double ax, double ay, double bx, double by) noexcept {
  const double dx = bx - ax, dy = by - ay;
  const double length2 = dx * dx + dy * dy;
  const double f =
      length2 > 0 ? std::clamp(((px - ax) * dx + (py - ay) * dy) / length2, 0.0, 1.0) : 0.0;
  return {f, std::hypot(px - ax - f * dx, py - ay - f * dy)};
}

}  // namespace

bool PathFollower::take(const Path& path) noexcept {
  if (has_path() && path.seq == seq_) return true;
  if (path.seq == 0 || path.size < 1 || path.size > Path::kMaxPoints) return false;
  for (int i = 0; i < path.size; ++i) {
    for (const double v : path.points[i]) {
      if (!std::isfinite(v)) return false;
    }
  }
  size_ = path.size;
  seq_ = path.seq;
  for (int i = 0; i < size_; ++i) {
    points_[i] = path.points[i];
    along_[i] = i == 0 ? 0
                       : along_[i - 1] + std::hypot(points_[i][0] - points_[i - 1][0],
                                                    points_[i][1] - points_[i - 1][1]);
  }
  progress_ = 0;
  arrived_ = false;
  return true;
}

Pose2 PathFollower::at(double s) const noexcept {
  const double* const first = along_.data();
  const auto i = static_cast<int>(std::upper_bound(first, first + size_, s) - first) - 1;
  if (i < 0) return point(0);
  if (i + 1 >= size_) return point(size_ - 1);
  const Pose2 a = point(i), b = point(i + 1);
  const double f = (s - along_[i]) / (along_[i + 1] - along_[i]);
  return {a.x + f * (b.x - a.x), a.y + f * (b.y - a.y),
          wrap_angle(a.yaw + f * wrap_angle(b.yaw - a.yaw))};
}

// Moves the progress to the nearest point of the window ahead.
void PathFollower::advance(const Pose2& X_WB, double& off) noexcept {
  const double from = progress_, to = progress_ + config_.search_m;
  double best = progress_;
  const Pose2 here = at(progress_);
  off = std::hypot(X_WB.x - here.x, X_WB.y - here.y);
  for (int i = 0; i + 1 < size_; ++i) {
    if (along_[i + 1] < from) continue;
    if (along_[i] > to) break;
    const Foot t =
        foot(X_WB.x, X_WB.y, points_[i][0], points_[i][1], points_[i + 1][0], points_[i + 1][1]);
    const double s = std::clamp(along_[i] + t.f * (along_[i + 1] - along_[i]), from, to);
    const Pose2 p = at(s);
    const double d = std::hypot(X_WB.x - p.x, X_WB.y - p.y);
    if (d < off) {
      off = d;
      best = s;
    }
  }
  progress_ = best;
}

double PathFollower::bend(const Pose2& from, double s0, double s1) const noexcept {
  const Pose2 to = at(s1);
  double worst = 0;
  for (int i = 0; i < size_; ++i) {
    if (along_[i] <= s0) continue;
    if (along_[i] >= s1) break;
    worst =
        std::max(worst, foot(points_[i][0], points_[i][1], from.x, from.y, to.x, to.y).distance);
  }
  return worst;
}

PathFollower::Goal PathFollower::next(const Pose2& predicted_X_WB) noexcept {
  Goal goal;
  advance(predicted_X_WB, goal.off_path_m);
  const double end = length();
  goal.progress_m = progress_;
  goal.remaining_m = end - progress_;

  // Path point: as far ahead as the bend allows. The straight way starts at the path's own point,
  // so that a base that is off the path is led back to it.
  const Pose2 on_path = at(progress_);
  const double allowed = 0.25 * config_.corridor_m;
  constexpr double kStep = 0.025;
  double s = std::min(progress_ + config_.look_ahead_m, end);
  const double nearest = std::min(progress_ + config_.look_ahead_min_m, end);
  while (s > nearest && bend(on_path, progress_, s) > allowed) s = std::max(nearest, s - kStep);
  // A base that is off the path by more than the corridor (the path was changed under way) is led
  // back first: the chord from it may not cut off what lies between the way back and the path.
  const auto cut = [&] {
    const Pose2 to = at(s);
    return foot(on_path.x, on_path.y, predicted_X_WB.x, predicted_X_WB.y, to.x, to.y).distance;
  };
  while (s > progress_ && cut() > config_.corridor_m) s = std::max(progress_, s - kStep);
  goal.X_WG = at(s);

  // The end of the path, if the whole way is as good as straight from where the base is.
  const Pose2 last = point(size_ - 1);
  const auto distance = [&](const Pose2& p) {
    return std::hypot(p.x - predicted_X_WB.x, p.y - predicted_X_WB.y);
  };
  if (s < end && goal.off_path_m <= allowed && distance(last) > distance(goal.X_WG) &&
      bend(predicted_X_WB, progress_, end) <= allowed) {
    // The yaw still turns along the path, as its clearance was planned.
    goal.X_WG.x = last.x;
    goal.X_WG.y = last.y;
    goal.is_mark = true;
    s = end;
  }
  goal.ahead_m = s - progress_;
  return goal;
}

bool PathFollower::update_arrival(const Pose2& X_WB, double speed_m_per_s) noexcept {
  if (!has_path()) return false;
  const Pose2 last = point(size_ - 1);
  if (length() - progress_ <= std::max(config_.arrive_m, config_.look_ahead_min_m) &&
      std::hypot(X_WB.x - last.x, X_WB.y - last.y) <= config_.arrive_m &&
      std::abs(wrap_angle(X_WB.yaw - last.yaw)) <= config_.arrive_rad &&
      speed_m_per_s <= config_.arrive_speed_m_per_s) {
    arrived_ = true;
  }
  return arrived_;
}

}  // namespace tasks
