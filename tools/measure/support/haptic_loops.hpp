// Closed loops of a hand over a textured floor, seeded, and what one of them costs: a force that is
// the slope of an energy costs nothing over any. In depth, along both tangents, each leg at its own
// pace: what follows the hand's speed shows.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "rt/random.hpp"
#include "tools/measure/support/haptic_rig.hpp"

namespace loops {

using rig::Vec3;

inline constexpr double kShallow_m = 0.0006, kDeep_m = 0.008;
inline constexpr double kSlow_m_per_s = 0.005, kFast_m_per_s = 0.1;
inline constexpr double kLimit_J = 0.02e-3;  // of a loop

struct Leg {
  Vec3 to = Vec3::Zero();  // S, z = -depth below where the tip rests
  double speed = 0;
};

// Three to six legs; the last ends where the first begins.
[[nodiscard]] inline std::vector<Leg> drawn(std::uint64_t seed) {
  rt::Random random(seed, 19);
  const auto even_log = [&](double least, double most) {
    return least * std::exp(random.uniform(0, std::log(most / least)));
  };
  const Vec3 centre(random.uniform(-0.005, 0.005), random.uniform(-0.005, 0.005), 0);
  const double wide = even_log(0.0003, 0.003);
  std::vector<Leg> out(static_cast<std::size_t>(random.integer(3, 6)));
  for (Leg& leg : out) {
    leg.to = centre + Vec3(random.uniform(-wide, wide), random.uniform(-wide, wide),
                           -even_log(kShallow_m, kDeep_m));
    leg.speed = even_log(kSlow_m_per_s, kFast_m_per_s);
  }
  return out;
}

// The hand's ticks on a straight way, `each` with every row.
template <class Each>
void go(rig::Rig& r, const Vec3& from, const Vec3& to, double speed, const Each& each) {
  const int ticks = std::max(1, static_cast<int>(std::ceil((to - from).norm() / (speed * 1e-3))));
  for (int i = 1; i <= ticks; ++i) {
    each(r.tick(from + (static_cast<double>(i) / ticks) * (to - from)));
  }
}

// Sum of mean force x step, J. The hand comes from `at` and is at the loop's first place behind it;
// `rest_m`: height at which the tip rests.
[[nodiscard]] inline double energy(rig::Rig& r, const std::vector<Leg>& loop, double rest_m,
                                   Vec3& at) {
  constexpr int kStill = 60;  // ticks: the guard is behind nothing any more
  const Vec3 up(0, 0, rest_m);
  const auto nothing = [](const rig::Row&) {};
  const Vec3 first = loop.back().to + up;
  go(r, at, first, kFast_m_per_s, nothing);
  at = first;
  for (int i = 1; i < kStill; ++i) r.tick(at);
  rig::Row last = r.tick(at);
  double sum = 0;
  for (const Leg& leg : loop) {
    go(r, at, leg.to + up, leg.speed, [&](const rig::Row& row) {
      sum += 0.5 * (row.f + last.f).dot(row.h - last.h);
      last = row;
    });
    at = leg.to + up;
  }
  return sum;
}

// The largest of `count` loops from `seed` on; the hand comes from 3 mm above the surface.
struct Worst {
  double energy_J = 0;
  std::uint64_t seed = 0;
};
[[nodiscard]] inline Worst worst_of(const rig::Scene& scene, std::uint64_t seed, int count) {
  rig::Rig r(scene);
  const double rest = scene.config.tip_radius_m;
  Vec3 at(0, 0, rest + 0.003);
  for (int i = 0; i < 10; ++i) r.tick(at);
  Worst out{0, seed};
  for (int i = 0; i < count; ++i) {
    const std::uint64_t each = seed + static_cast<std::uint64_t>(i);
    const double e = std::abs(energy(r, drawn(each), rest, at));
    if (!(e <= out.energy_J)) out = {e, each};
  }
  return out;
}

}  // namespace loops
