#include "tasks/prediction/motion_history.hpp"

#include <cmath>

namespace tasks {
namespace {

using perception::Pose2;
using perception::Twist2;

bool plausible(double a, double b, double c) noexcept {
  constexpr double k = MotionHistory::kLargest;
  return std::abs(a) <= k && std::abs(b) <= k && std::abs(c) <= k;  // false for NaN
}

}  // namespace

Twist2 way_between(const Pose2& from, const Pose2& to) noexcept {
  const Pose2 d = perception::compose(perception::inverse(from), to);
  const double half = 0.5 * d.yaw;
  const double k = std::abs(half) < 1e-6 ? 1.0 : half / std::tan(half);
  return {k * d.x + half * d.y, -half * d.x + k * d.y, d.yaw};
}

MotionHistory::MotionHistory() : entries_(kEntries), commands_(kCommands) {}

void MotionHistory::clear() noexcept { head_ = size_ = command_head_ = command_size_ = 0; }

bool MotionHistory::add(const MotionSample& s) noexcept {
  if (!std::isfinite(s.t) || !plausible(s.X_OB.x, s.X_OB.y, s.X_OB.yaw) ||
      !plausible(s.v_B.vx, s.v_B.vy, s.v_B.wz)) {
    return false;
  }
  if (size_ > 0 && !(s.t > newest().t)) return false;
  // A faster source is thinned: the newest sample is always kept, those behind it are spaced out.
  if (size_ >= 2 && s.t - at(size_ - 2).sample.t < kMinSpacing_s) --size_;
  if (size_ == kEntries) {
    head_ = (head_ + 1) % kEntries;
    --size_;
  }
  Entry e;
  e.sample = s;
  if (size_ > 0) {
    const Entry& last = at(size_ - 1);
    const Axes a = axes(last.sample.v_B), b = axes(s.v_B);
    for (std::size_t k = 0; k < 3; ++k) {
      e.travelled[k] = last.travelled[k] + 0.5 * (a[k] + b[k]) * (s.t - last.sample.t);
    }
  }
  entries_[(head_ + size_) % kEntries] = e;
  ++size_;
  return true;
}

bool MotionHistory::add_command(double t, const Twist2& cmd_B) noexcept {
  if (!std::isfinite(t) || !plausible(cmd_B.vx, cmd_B.vy, cmd_B.wz)) return false;
  if (command_size_ > 0 && !(t > commands_[(command_head_ + command_size_ - 1) % kCommands].t)) {
    return false;
  }
  if (command_size_ == kCommands) {
    command_head_ = (command_head_ + 1) % kCommands;
    --command_size_;
  }
  commands_[(command_head_ + command_size_) % kCommands] = {t, axes(cmd_B)};
  ++command_size_;
  return true;
}

// Index of the last entry not after t; 0 when all are after it.
std::size_t MotionHistory::last_not_after(double t) const noexcept {
  std::size_t lo = 0, hi = size_;
  while (hi - lo > 1) {
    const std::size_t mid = lo + (hi - lo) / 2;
    (at(mid).sample.t <= t ? lo : hi) = mid;
  }
  return lo;
}

Axes MotionHistory::velocity(double t, std::size_t& hint) const noexcept {
  while (hint > 0 && at(hint).sample.t > t) --hint;
  const Entry& a = at(hint);
  Axes v = axes(a.sample.v_B);
  if (hint + 1 >= size_) return v;
  const Entry& b = at(hint + 1);
  const double f = (t - a.sample.t) / (b.sample.t - a.sample.t);
  const Axes w = axes(b.sample.v_B);
  for (std::size_t k = 0; k < 3; ++k) v[k] += f * (w[k] - v[k]);
  return v;
}

Axes MotionHistory::travelled(double t, std::size_t& hint) const noexcept {
  const Axes v = velocity(t, hint);
  const Entry& a = at(hint);
  const Axes u = axes(a.sample.v_B);
  Axes out = a.travelled;
  for (std::size_t k = 0; k < 3; ++k) out[k] += 0.5 * (u[k] + v[k]) * (t - a.sample.t);
  return out;
}

const Axes* MotionHistory::command_at(double t) const noexcept {
  std::size_t lo = 0, hi = command_size_;
  while (lo < hi) {  // first command after t
    const std::size_t mid = lo + (hi - lo) / 2;
    if (commands_[(command_head_ + mid) % kCommands].t <= t)
      lo = mid + 1;
    else
      hi = mid;
  }
  return lo == 0 ? nullptr : &commands_[(command_head_ + lo - 1) % kCommands].value;
}

bool MotionHistory::pose_at(double t, Pose2& out) const noexcept {
  if (size_ == 0 || !(t >= first_t()) || t > newest().t) return false;
  const std::size_t i = last_not_after(t);
  const MotionSample& a = at(i).sample;
  if (i + 1 >= size_ || t == a.t) {
    out = a.X_OB;
    return true;
  }
  // Between two poses: along the arc that joins them.
  const MotionSample& b = at(i + 1).sample;
  const double f = (t - a.t) / (b.t - a.t);
  const Twist2 log = way_between(a.X_OB, b.X_OB);
  out = perception::compose(a.X_OB, perception::exp_se2({f * log.vx, f * log.vy, f * log.wz}));
  return true;
}

}  // namespace tasks
