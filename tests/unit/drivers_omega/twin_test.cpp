#include "drivers/omega/omega_twin.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::DeviceState;
using drivers::ForceCommand;
using drivers::ForceOffCause;
using drivers::HandScript;
using drivers::HandScriptConfig;
using drivers::HandSegmentConfig;
using drivers::OmegaTwin;
using drivers::OmegaTwinConfig;
using drivers::StylusSample;
using drivers::WorkspaceMap;
using perception::Vec3;

constexpr rt::Time kStart = rt::time_from_ns(77'000'000'123);

OmegaTwinConfig ideal() {
  OmegaTwinConfig c;
  c.coulomb_N = 0;
  c.quantum_m = 0;
  c.hand_stiffness_N_per_m = 0;
  c.speed_limit_m_per_s = 20;
  return c;
}

struct Device {
  rt::Startup startup;
  OmegaTwin twin;
  rt::Time now = kStart;
  StylusSample sample;
  explicit Device(const OmegaTwinConfig& c, HandScript* hand = nullptr,
                  const Vec3& p = Vec3::Zero())
      : twin(startup.token(), c, hand, p) {
    EXPECT_TRUE(twin.sense(now, sample));
  }
  void tick(const Vec3& f = Vec3::Zero(), bool command = true) {
    rt::Section section;
    now += 1ms;
    (void)twin.sense(now, sample);
    if (command) twin.act(now, {f});
  }
};

// The hand's spring and damper on the mass, target at rest: the closed form of a damped
// oscillation.
TEST(OmegaTwin, FreeOscillationMatchesClosedForm) {
  rt::Startup startup;
  for (const double damping : {0.5, 3.0}) {
    OmegaTwinConfig c = ideal();
    c.damping_N_s_per_m = damping;
    c.hand_stiffness_N_per_m = 400;
    c.hand_damping_N_s_per_m = 1.0;
    c.hand_mass_kg = 0.3;
    HandScript hand(startup.token(), {}, {});
    const Vec3 start(0.03, -0.01, 0.02);
    Device d(c, &hand, start);
    const double m = 0.5, b = damping + 1.0, k = 400;
    const double decay = b / (2 * m), w = std::sqrt(k / m - decay * decay);
    double worst = 0;
    for (int ms = 1; ms <= 1000; ++ms) {
      d.tick();
      const double t = ms * 1e-3;
      const double f = std::exp(-decay * t) * (std::cos(w * t) + decay / w * std::sin(w * t));
      worst = std::max(worst, (d.sample.p_DH - f * start).norm());
    }
    EXPECT_LT(worst, 1e-12);
  }
}

// Under a held force without friction the sub-step does not matter: it is exact.
TEST(OmegaTwin, SubStepDoesNotMatterWithoutFriction) {
  const std::uint64_t seed = 61;
  OmegaTwinConfig fine = ideal(), coarse = ideal();
  fine.substep_us = 5;
  coarse.substep_us = 50;
  Device a(fine), b(coarse);
  rt::Random random(seed);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 f(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const Vec3 pull = -40 * a.sample.p_DH;
    a.tick(f + pull);
    b.tick(f + pull);
    ASSERT_LT((a.sample.p_DH - b.sample.p_DH).norm(), 1e-12) << "seed " << seed;
  }
}

TEST(OmegaTwin, CoulombFrictionHoldsAndStops) {
  OmegaTwinConfig c = ideal();
  c.coulomb_N = 0.3;
  c.damping_N_s_per_m = 0;
  {
    Device d(c);
    for (int i = 0; i < 200; ++i) d.tick({0.2, 0.2, 0});  // 0.283 N < 0.3 N
    EXPECT_EQ(d.sample.p_DH, Vec3::Zero());
    for (int i = 0; i < 200; ++i) d.tick({0.4, 0, 0});
    EXPECT_NEAR(d.sample.p_DH.x(), 0.5 * (0.1 / 0.2) * 0.2 * 0.2, 2e-4);
  }
  {
    Device d(c);
    d.twin.push({0.2, 0.1, 0});
    for (int i = 0; i < 400; ++i) d.tick();
    // m v^2 / 2 = c s
    EXPECT_NEAR(d.sample.p_DH.norm(), 0.2 * 0.05 / (2 * 0.3), 1e-5);
    EXPECT_EQ(d.twin.true_velocity(), Vec3::Zero());
  }
}

TEST(OmegaTwin, DoesNotDependOnWhoAsks) {
  const std::uint64_t seed = 63;
  rt::Startup startup;
  HandScriptConfig script;
  HandSegmentConfig& s = script.segments.emplace_back();
  s.kind = "move";
  s.point_m = {0.03, 0.01, 0};
  s.standoff_m = 0.01;
  HandScript h1(startup.token(), script, {}), h2(startup.token(), script, {});
  OmegaTwinConfig c;  // everything on
  c.delay_s = 0.0003;
  c.gravity_mass_kg = 0.1;
  Device quiet(c, &h1), asked(c, &h2);
  rt::Random random(seed);
  StylusSample dummy;
  for (int i = 0; i < 1500; ++i) {
    for (int n = 0; n < 4; ++n) {
      (void)asked.twin.sense(asked.now + rt::Nanos{random.integer(0, 999'999)}, dummy);
    }
    const Vec3 f = quiet.sample.p_DH.x() > 0.02 ? Vec3(-1000 * (quiet.sample.p_DH.x() - 0.02), 0, 0)
                                                : Vec3(Vec3::Zero());
    quiet.tick(f);
    asked.tick(f);
    ASSERT_EQ(std::memcmp(quiet.sample.p_DH.data(), asked.sample.p_DH.data(), 24), 0)
        << "seed " << seed << " tick " << i;
    ASSERT_EQ(std::memcmp(quiet.twin.true_velocity().data(), asked.twin.true_velocity().data(), 24),
              0);
  }
  EXPECT_GT(quiet.sample.p_DH.x(), 0.02);
}

TEST(OmegaTwin, ReportsWholeQuanta) {
  OmegaTwinConfig c = ideal();
  c.quantum_m = 1e-5;
  Device d(c);
  d.twin.push({0.0123, 0.02, -0.0077});
  for (int i = 0; i < 500; ++i) {
    d.tick();
    for (int k = 0; k < 3; ++k) {
      const double n = d.sample.p_DH[k] / 1e-5;
      ASSERT_NEAR(n, std::round(n), 1e-6);
      ASSERT_NEAR(d.sample.p_DH[k], d.twin.true_position()[k], 0.5e-5 + 1e-12);
    }
  }
}

TEST(OmegaTwin, StatesAndWatchdog) {
  Device d(ideal());
  EXPECT_EQ(d.sample.state, DeviceState::kIdle);
  d.tick({1, 0, 0});
  d.tick({1, 0, 0});
  EXPECT_EQ(d.sample.state, DeviceState::kForce);
  for (int i = 0; i < 20; ++i) d.tick(Vec3::Zero(), false);
  EXPECT_EQ(d.sample.state, DeviceState::kForce);  // 20 ms without a command: still allowed
  d.tick(Vec3::Zero(), false);
  EXPECT_EQ(d.sample.state, DeviceState::kBrake);
  EXPECT_EQ(d.twin.force_off_cause(), ForceOffCause::kWatchdog);
  EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
  // Commands do not bring it back; an act does, and it starts without force.
  d.tick({1, 0, 0});
  d.tick({1, 0, 0});
  EXPECT_EQ(d.sample.state, DeviceState::kBrake);
  EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
  EXPECT_TRUE(d.twin.enable_force(d.now));
  EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
  d.tick({1, 0, 0});
  d.tick({1, 0, 0});
  EXPECT_EQ(d.sample.state, DeviceState::kForce);
  EXPECT_EQ(d.twin.motor_force(), Vec3(1, 0, 0));
  EXPECT_EQ(d.twin.brakes(), 1U);
}

TEST(OmegaTwin, WatchdogActsAtItsInstantWhenReadLate) {
  Device d(ideal());
  d.tick({0.5, 0, 0});
  d.now += 500ms;
  d.tick(Vec3::Zero(), false);
  EXPECT_EQ(d.sample.state, DeviceState::kBrake);
  // 0.5 N for 20 ms on 0.2 kg with b = 2, then the brake: under 2 mm, not the 30 cm of 500 ms.
  EXPECT_LT(d.sample.p_DH.x(), 0.002);
  EXPECT_GT(d.sample.p_DH.x(), 0.0003);
}

TEST(OmegaTwin, OverSpeedBrakes) {
  OmegaTwinConfig c = ideal();
  c.speed_limit_m_per_s = 0.5;
  Device d(c);
  d.tick();
  d.twin.push({0.49, 0, 0});
  d.tick();
  EXPECT_EQ(d.sample.state, DeviceState::kForce);
  d.twin.push({0.1, 0, 0});
  d.tick({5, 0, 0});
  EXPECT_EQ(d.sample.state, DeviceState::kBrake);
  EXPECT_EQ(d.twin.force_off_cause(), ForceOffCause::kVelocity);
  const double v = d.twin.true_velocity().norm();
  for (int i = 0; i < 20; ++i) d.tick({5, 0, 0});
  // The brake is viscous: exp(-(b + brake) t / m) and no force.
  EXPECT_NEAR(d.twin.true_velocity().norm(), v * std::exp(-17.0 * 0.020 / 0.2), 1e-9);
}

TEST(OmegaTwin, MakeSafeForceButtonUnplugCalibration) {
  {
    Device d(ideal());
    d.tick({1, 0, 0});
    d.twin.make_safe();
    d.tick({1, 0, 0});
    EXPECT_EQ(d.sample.state, DeviceState::kBrake);
    EXPECT_EQ(d.twin.force_off_cause(), ForceOffCause::kSoftware);
    d.tick({1, 0, 0});
    EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
    EXPECT_TRUE(d.twin.enable_force(d.now));
  }
  {
    Device d(ideal());
    d.tick({1, 0, 0});
    d.twin.faults().force_button = true;
    d.tick({1, 0, 0});
    EXPECT_EQ(d.sample.state, DeviceState::kBrake);
    EXPECT_EQ(d.twin.force_off_cause(), ForceOffCause::kButton);
  }
  {
    Device d(ideal());
    d.tick({1, 0, 0});
    d.twin.faults().unplugged = true;
    StylusSample s = d.sample;
    EXPECT_FALSE(d.twin.sense(d.now + 1ms, s));
    EXPECT_EQ(s.seq, d.sample.seq);  // untouched
    EXPECT_EQ(d.twin.state(), DeviceState::kBrake);
    EXPECT_FALSE(d.twin.enable_force(d.now + 2ms));
    d.twin.faults().unplugged = false;
    EXPECT_TRUE(d.twin.enable_force(d.now + 3ms));
  }
  {
    OmegaTwinConfig c = ideal();
    c.calibrated = false;
    Device d(c);
    d.tick({1, 0, 0});
    d.tick({1, 0, 0});
    EXPECT_EQ(d.sample.state, DeviceState::kReset);
    EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
    EXPECT_FALSE(d.twin.enable_force(d.now));
    d.twin.calibrate();
    d.tick({1, 0, 0});
    d.tick({1, 0, 0});
    EXPECT_EQ(d.sample.state, DeviceState::kForce);
    d.twin.faults().lose_calibration = true;
    d.tick({1, 0, 0});
    EXPECT_EQ(d.sample.state, DeviceState::kReset);
  }
}

TEST(OmegaTwin, SampleFaults) {
  Device d(ideal());
  d.twin.push({0.1, 0, 0});
  d.tick();
  const StylusSample first = d.sample;
  d.twin.faults().repeat = 2;
  d.tick();
  EXPECT_TRUE(d.sample.repeated);
  EXPECT_EQ(d.sample.seq, first.seq);
  EXPECT_EQ(d.sample.p_DH, first.p_DH);
  d.tick();
  EXPECT_TRUE(d.sample.repeated);
  d.tick();
  EXPECT_FALSE(d.sample.repeated);
  EXPECT_GT(d.sample.p_DH.x(), first.p_DH.x());
  EXPECT_EQ(d.twin.repeats(), 2U);
  d.twin.faults().nan_position = true;
  d.tick();
  EXPECT_TRUE(std::isnan(d.sample.p_DH.y()));
  d.twin.faults().nan_position = false;
  d.twin.faults().jump_m = {0, 0.01, 0};
  d.tick();
  EXPECT_EQ(d.sample.p_DH.y(), 0.01);
  d.twin.faults().jump_m.setZero();
  d.twin.faults().frozen = true;
  d.tick();
  const double x = d.sample.p_DH.x();
  d.tick();
  EXPECT_EQ(d.sample.p_DH.x(), x);
  d.twin.faults().frozen = false;
  d.tick();
  EXPECT_GT(d.sample.p_DH.x(), x);
  EXPECT_FALSE(d.sample.button);
  d.twin.faults().stuck_button = true;
  d.tick();
  EXPECT_TRUE(d.sample.button);
}

TEST(OmegaTwin, DroppedCommandsAndNaNCommands) {
  Device d(ideal());
  d.tick({1, 0, 0});
  d.twin.faults().drop_commands = 2;
  d.tick({2, 0, 0});
  d.tick({2, 0, 0});
  d.tick({3, 0, 0});
  d.tick({std::nan(""), 0, 0});
  EXPECT_EQ(d.twin.motor_force(), Vec3(3, 0, 0));  // until the NaN command's turn
  d.tick();
  EXPECT_EQ(d.twin.motor_force(), Vec3::Zero());
  EXPECT_TRUE(d.sample.p_DH.allFinite());
}

TEST(OmegaTwin, TimeGuardRepeatsNearReads) {
  OmegaTwinConfig c = ideal();
  c.time_guard_s = 0.0015;
  Device d(c);
  d.twin.push({0.05, 0, 0});
  int repeated = 0;
  for (int i = 0; i < 100; ++i) {
    d.tick();
    repeated += d.sample.repeated ? 1 : 0;
  }
  EXPECT_EQ(repeated, 50);
}

TEST(OmegaTwin, ForceSaturatesOnTheSumWithGravity) {
  OmegaTwinConfig c = ideal();
  c.gravity_mass_kg = 0.3;
  Device d(c);
  d.tick();
  d.tick();
  EXPECT_NEAR(d.twin.motor_force().z(), 0.3 * 9.81, 1e-12);
  for (int i = 0; i < 1000; ++i) d.tick();
  const Vec3 hanging = d.sample.p_DH;  // it fell a little before the first command
  for (int i = 0; i < 1000; ++i) d.tick();
  EXPECT_LT((d.sample.p_DH - hanging).norm(), 1e-5);
  for (int i = 0; i < 2; ++i) d.tick({0, 20, 20});
  EXPECT_NEAR(d.twin.motor_force().norm(), 12.0, 1e-12);
}

TEST(OmegaTwin, EndStopKeepsTheTipInTheWorkspace) {
  Device d(ideal());
  for (int i = 0; i < 3000; ++i) d.tick({10, 0, 0});
  EXPECT_LT(d.sample.p_DH.norm(), 0.075 + 10.0 / 5000 + 1e-3);
  EXPECT_GT(d.sample.p_DH.norm(), 0.074);
}

TEST(OmegaTwin, RefusesContradictions) {
  rt::Startup startup;
  OmegaTwinConfig c;
  EXPECT_THROW(OmegaTwin(startup.token(), c, nullptr, {0.2, 0, 0}), std::invalid_argument);
  EXPECT_THROW(OmegaTwin(startup.token(), c, nullptr, {std::nan(""), 0, 0}), std::invalid_argument);
}

TEST(OmegaTwin, EffectsAreListed) {
  EXPECT_TRUE(Device(ideal()).twin.effects().empty());
  EXPECT_EQ(Device(OmegaTwinConfig{}).twin.effects().size(), 2U);  // friction and quantum
}

// --- Stability of a stiff wall against the sampled-data bound K < b / (T/2 + t_d). ---

// Largest stiffness, to 1 %, at which a device that is pushed into a wall at x = 0 with 3 N comes
// to rest within 7 s. It starts at the depth where the forces balance, with 10 mm/s.
double largest_stable_stiffness(double b, double delay_s) {
  const auto residual_speed = [&](double K) {
    OmegaTwinConfig c = ideal();
    c.quantum_m = 1e-5;
    c.damping_N_s_per_m = b;
    c.delay_s = delay_s;
    c.force_limit_N = 50;
    Device d(c, nullptr, Vec3(std::min(3 / K, 0.07), 0, 0));
    d.twin.act(d.now, {Vec3(-3, 0, 0)});
    double worst = 0;
    for (int i = -5; i < 7000; ++i) {
      // The push comes with the first force that balances it, behind the delay.
      if (i == -5 + std::lround(delay_s * 1e3)) d.twin.set_external_force({3, 0, 0});
      if (i == 0) d.twin.push({0.01, 0, 0});
      rt::Section section;
      d.now += 1ms;
      (void)d.twin.sense(d.now, d.sample);
      const double depth = d.sample.p_DH.x();
      d.twin.act(d.now, {Vec3(i < 0 ? -3.0 : depth > 0 ? -K * depth : 0.0, 0, 0)});
      if (i >= 6900) worst = std::max(worst, std::abs(d.twin.true_velocity().x()));
    }
    return worst;
  };
  double lo = 50, hi = 20 * b / 0.0005;
  while (hi / lo > 1.01) {
    const double mid = std::sqrt(lo * hi);
    (residual_speed(mid) < 0.003 ? lo : hi) = mid;
  }
  return lo;
}

TEST(OmegaTwin, StiffWallBoundary) {
  for (const double b : {0.5, 1.0, 2.0}) {
    for (const double delay : {0.0, 0.001}) {
      const double bound = b / (0.0005 + delay);
      const double K = largest_stable_stiffness(b, delay);
      std::printf("b %.1f N s/m, delay %.0f ms: K max %.0f N/m, bound %.0f, ratio %.2f\n", b,
                  1e3 * delay, K, bound, K / bound);
      EXPECT_GT(K, 0.8 * bound);
      EXPECT_LT(K, 1.2 * bound);
    }
  }
}

}  // namespace
