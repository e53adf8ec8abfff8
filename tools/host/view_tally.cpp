#include "tools/host/view_tally.hpp"

#include <algorithm>
#include <cmath>

namespace teletact {

namespace {

constexpr double kJump_N = 0.5, kStretch_m = 1e-4;
using Vec3f = std::array<float, 3>;

double dot_of(const Vec3f& a, const Vec3f& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += static_cast<double>(a[i]) * static_cast<double>(b[i]);
  return sum;
}
Vec3f less(const Vec3f& a, const Vec3f& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

}  // namespace

void HapticTally::add(const tasks::HapticSample& s, double touch_N_per_m) {
  ++ticks;
  force_N = std::max(force_N, static_cast<double>(s.force_N));
  step_N = std::max(step_N, static_cast<double>(s.step_N));
  step_raw_N = std::max(step_raw_N, static_cast<double>(s.step_raw_N));
  reach = std::max(reach, static_cast<double>(s.reach));
  contact += s.in_contact ? 1 : 0;
  guard += s.in_contact && s.guard_use ? 1 : 0;
  contacts += s.in_contact && !(has_last && last.in_contact) ? 1 : 0;
  not_finite += s.finite ? 0 : 1;
  clutched += s.clutched ? 1 : 0;
  // What the method did that a surface does not: by the ticks alone, whatever the method is.
  if (s.in_contact && has_last && last.in_contact) {
    const Vec3f moved = less(s.p_WH, last.p_WH);
    const double most = touch_N_per_m * std::sqrt(dot_of(moved, moved)) + kJump_N;
    jumps += static_cast<double>(s.step_raw_N) > most ? 1 : 0;
  }
  const Vec3f stretch = less(s.p_WP, s.p_WH);
  const double long_m = std::sqrt(dot_of(stretch, stretch));
  if (!s.in_contact) {
    entry = {};
  } else if (long_m > kStretch_m && (dot_of(entry, entry) == 0 || dot_of(stretch, entry) < 0)) {
    flips += dot_of(entry, entry) > 0 ? 1 : 0;
    entry = stretch;
  }
  last = s;
  has_last = true;
}

void FusionTally::add(const tasks::FusionSample& s) noexcept {
  moving += s.moving_share > 0 ? 1 : 0;
  moving_cells = std::max(moving_cells, s.moving_cells);
  consumed += s.consumed ? 1 : 0;
  tracked += s.tracked ? 1 : 0;
  claimed += s.claimed ? 1 : 0;
}

}  // namespace teletact
