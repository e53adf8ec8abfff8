// Passivity controller on a bare spring, held between ticks, against hands that try to get energy
// out of it.
#include "tasks/haptic/passivity.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "rt/random.hpp"
#include "tasks/haptic/energy.hpp"

namespace {

using perception::Vec3;
using tasks::EnergyObserver;
using tasks::PassivityController;
using tasks::VelocityWindow;

constexpr double kQuantum = 1e-5;

double quantised(double x) { return kQuantum * std::round(x / kQuantum); }

// A wall below z = 0 that pushes up, 12 N at most.
class Wall {
 public:
  Wall(double stiffness, double rate_hz, bool controller)
      : stiffness_(stiffness),
        period_(1 / rate_hz),
        on_(controller),
        controller_(0.2, kQuantum, period_) {}
  // Hand at z; returns the force until the next call.
  double tick(double z) {
    const Vec3 p(0, 0, quantised(z)), dx = begun_ ? Vec3(p - last_) : Vec3(Vec3::Zero());
    last_ = p;
    begun_ = true;
    energy_.move(force_, dx);
    controller_.see(p);
    const double depth = std::max(0.0, -p.z()), knee = 12 / stiffness_;
    const double spring =
        depth < knee ? 0.5 * stiffness_ * depth * depth : 0.5 * 12 * knee + 12 * (depth - knee);
    energy_.book(0, spring - spring_, period_);
    spring_ = spring;
    force_ = Vec3(0, 0, std::min(12.0, stiffness_ * depth));
    if (on_ && depth > 0) {
      force_ = controller_.limited(force_, dx, energy_.reserve_J(), spring, stiffness_, period_);
    }
    lowest_ = std::min(lowest_, energy_.energy_J());
    return force_.z();
  }
  [[nodiscard]] double lowest_J() const { return lowest_; }
  [[nodiscard]] double energy_J() const { return energy_.energy_J(); }

 private:
  double stiffness_, period_;
  bool on_, begun_ = false;
  PassivityController controller_;
  EnergyObserver energy_;
  Vec3 last_ = Vec3::Zero(), force_ = Vec3::Zero();
  double spring_ = 0, lowest_ = 0;
};

// Encoder steps in and out, swings, random pushes of up to 40 m/s^2: two seconds of one of them
// after the other.
template <class Tick>
void play(std::uint64_t seed, double rate_hz, double depth_m, const Tick& tick) {
  rt::Random random(seed);
  const double T = 1 / rate_hz;
  double z = 0.001, v = 0;
  const auto ticks = static_cast<int>(2 * rate_hz), part = static_cast<int>(0.1 * rate_hz);
  int mode = 0;
  double push = 0, w = 0;
  for (int k = 0; k < ticks; ++k) {
    if (k % part == 0) {
      mode = static_cast<int>(random.integer(0, 2));
      w = 2 * std::numbers::pi * random.uniform(2, 60);
    }
    const double towards = -depth_m - z;
    if (mode == 0) {  // pushed about
      if (random.uniform() < 0.05) push = random.uniform(-40, 40);
      v += T * std::clamp(push + 2000 * towards - 10 * v, -40.0, 40.0);
    } else if (mode == 1) {  // a swing
      v += T * std::clamp(w * w * towards, -40.0, 40.0);
    } else {  // a spring-held hand at rest
      v += T * std::clamp(4e3 * towards - 120 * v, -40.0, 40.0);
    }
    z += T * v;
    const double rattle = mode == 2 ? kQuantum * static_cast<double>(random.integer(0, 1)) : 0;
    tick(z + rattle);
  }
}

TEST(Passivity, NoHandGetsMoreThanAMillijoule) {
  constexpr std::uint64_t kSeed = 11;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  double on = 0, off = 0;
  for (int i = 0; i < 150; ++i) {
    const double rate = std::array{1000.0, 2000.0, 4000.0}[static_cast<std::size_t>(i % 3)];
    const double stiffness = std::exp(random.uniform(std::log(300.0), std::log(3e4)));
    const double depth = random.uniform(0.2, 8) / stiffness;
    Wall with(stiffness, rate, true), without(stiffness, rate, false);
    play(kSeed + static_cast<std::uint64_t>(i), rate, depth, [&](double z) {
      (void)with.tick(z);
      (void)without.tick(z);
    });
    EXPECT_GE(with.lowest_J(), -1e-3) << rate << " Hz, K " << stiffness << ", draw " << i;
    on = std::min(on, with.lowest_J());
    off = std::min(off, without.lowest_J());
  }
  std::printf("lowest E: %.3f mJ, without the controller %.1f mJ\n", 1e3 * on, 1e3 * off);
  EXPECT_LT(off, -5e-3) << "these hands get nothing anyway";
}

// A wall that never made any energy is left alone: a slow touch at the force of the spring.
TEST(Passivity, LeavesASlowTouchAlone) {
  for (const double rate : {1000.0, 4000.0}) {
    Wall with(1000, rate, true), without(1000, rate, false);
    double most = 0;
    for (int k = 0; k < static_cast<int>(2 * rate); ++k) {
      const double t = k / rate, z = 0.002 - 0.008 * std::sin(std::numbers::pi * t / 2);
      const double a = with.tick(z), b = without.tick(z);
      most = std::max(most, std::abs(a - b));
    }
    EXPECT_LT(most, 0.02) << rate;
  }
}

TEST(Velocity, OfASteadyMotionIsRightToItsResolution) {
  rt::Random random(5);
  for (const double rate : {1000.0, 2000.0, 4000.0}) {
    for (int i = 0; i < 50; ++i) {
      const Vec3 v(random.uniform(-0.3, 0.3), random.uniform(-0.05, 0.05),
                   random.uniform(-0.01, 0.01));
      VelocityWindow w(kQuantum, 1 / rate);
      for (int k = 0; k < 40; ++k) {
        const Vec3 p = v * (k / rate);
        w.see({quantised(p.x()), quantised(p.y()), quantised(p.z())});
      }
      // One step over the longest window: 8 ms at 1 and 2 kHz, 4 ms at 4 kHz.
      const double resolution = kQuantum / (rate > 3000 ? 0.004 : 0.008);
      EXPECT_LT((w.velocity() - v).cwiseAbs().maxCoeff(), 1.01 * resolution) << rate;
    }
  }
}

TEST(Velocity, ARattleBetweenTwoStepsIsAlmostNone) {
  rt::Random random(6);
  VelocityWindow w(kQuantum, 1e-3);
  for (int k = 0; k < 2000; ++k) {
    w.see({0, 0, random.uniform() < 0.5 ? kQuantum : 0});
    if (k < 9) continue;
    EXPECT_LE(w.velocity().norm(), 1.01 * kQuantum / 0.008);
  }
}

TEST(Velocity, FollowsATurnWithinThreeTicks) {
  VelocityWindow w(kQuantum, 1e-3);
  for (int k = 0; k < 50; ++k) w.see({0.1e-3 * k, 0, 0});
  EXPECT_NEAR(w.velocity().x(), 0.1, 1e-9);
  for (int k = 1; k <= 3; ++k) w.see({0.1e-3 * (49 - k), 0, 0});
  EXPECT_LT(w.velocity().x(), -0.05);
  w.forget();
  w.see({0, 0, 0});
  EXPECT_EQ(w.velocity().norm(), 0);
}

}  // namespace
