// How hard a bump of the texture pushes, one way through it: f of effects.hpp and what follows
// from it. All lengths are scene metres, all forces are over K. Nothing here allocates or throws.
#pragma once

#include <algorithm>
#include <cmath>

namespace tasks {

// f(x) and its integral from 0 (effects.hpp).
struct Felt {
  double f = 0, energy = 0;
};
[[nodiscard]] inline Felt felt(double x, double reach_m) noexcept {
  if (x <= 0) return {};
  if (x <= reach_m) return {x, 0.5 * x * x};
  const double u = std::min(x - reach_m, 0.5 * reach_m), over = x - reach_m - u;
  const double f = reach_m + u - u * u / reach_m;
  const double rounded =
      0.5 * reach_m * reach_m + reach_m * u + 0.5 * u * u - u * u * u / (3 * reach_m);
  return {f, rounded + f * over};
}

struct BumpForce {
  double pull_m = 0;     // along the normal: F / K
  double stretch_m = 0;  // K stretch^2 / 2 is the energy
  double along_m = 0;    // times the slope of the bump: the part along the surface over K
};
// `bump_m`: D, how deep the hand is below the bump; `deep_m`: how deep below the smooth surface, 0
// above it.
[[nodiscard]] inline BumpForce bump_force(double bump_m, double deep_m, double reach_m) noexcept {
  const Felt on_bump = felt(bump_m, reach_m);
  BumpForce out{std::max(bump_m, 0.0), std::max(bump_m, 0.0), on_bump.f};
  if (std::max(bump_m, deep_m) > reach_m) {
    const Felt below = felt(deep_m, reach_m);
    out.pull_m = deep_m + on_bump.f - below.f;
    out.stretch_m = std::sqrt(std::max(0.0, deep_m * deep_m + 2 * (on_bump.energy - below.energy)));
  }
  return out;
}

}  // namespace tasks
