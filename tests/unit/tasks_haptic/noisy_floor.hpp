// A floor whose height is drawn anew in every window, alike over some 30 mm: the noise of fusion
// under a camera that shakes, as a hand meets it.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "rt/random.hpp"
#include "tests/unit/tasks_haptic/floor.hpp"

namespace rig {

// Height over (x, y) of one window: a sum of waves with random directions, normal with deviation
// sigma_m, correlation exp(-r^2 / (2 reach^2)).
class Waves {
 public:
  Waves(double sigma_m, double reach_m, std::uint64_t seed, int frame)
      : size_m_(sigma_m * std::sqrt(2.0 / kWaves)) {
    rt::Random random(rt::mix64(0x6e6f697379, seed), static_cast<std::uint64_t>(frame));
    for (auto& wave : waves_) {
      for (double& k : wave.k) k = random.normal() / reach_m;
      wave.phase = random.uniform(0, 2 * std::numbers::pi);
    }
  }
  [[nodiscard]] double operator()(double x, double y) const {
    double sum = 0;
    for (const auto& wave : waves_) sum += std::cos(wave.k[0] * x + wave.k[1] * y + wave.phase);
    return size_m_ * sum;
  }

 private:
  static constexpr int kWaves = 24;
  struct Wave {
    std::array<double, 2> k{};
    double phase = 0;
  };
  double size_m_;
  std::array<Wave, kWaves> waves_{};
};

// How far the floor goes down (negative: comes up) beside its noise, m, from a time on.
using Sinks = std::function<double(double t)>;

inline Scene noisy_floor_scene(double sigma_m, std::uint64_t seed, Sinks sinks = {}) {
  constexpr double kReach_m = 0.03;
  struct Heights {
    int frame = -1;
    std::optional<Waves> waves;
    std::map<std::pair<int, int>, double> of;
  };
  Scene s = floor_scene();
  if (sinks) {
    s.solid = [=](const Vec3& p, double t) { return solids::floor(p) + sinks(t); };
  } else {
    s.still = true;
  }
  s.extra = [=, voxel = s.voxel, heights = std::make_shared<Heights>()](int x, int y, int,
                                                                        int frame) {
    if (heights->frame != frame) *heights = {frame, Waves(sigma_m, kReach_m, seed, frame), {}};
    const auto [at, is_new] = heights->of.try_emplace({x, y}, 0.0);
    if (is_new) at->second = (*heights->waves)(voxel * x, voxel * y);
    return -at->second;
  };
  return s;
}

}  // namespace rig
