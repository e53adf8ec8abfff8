// The real driver, against the twin library with the SDK's C functions.
#include "drivers/omega/omega_device.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "drivers/haptic/force_sum.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_omega/twin_rig.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::OmegaTwin;
using drivers::OmegaTwinConfig;
using drivers::StylusSample;
using namespace twin_rig;

// Friction, quantum, hand: the same trajectory to the last bit as the mechanics used directly.
TEST(OmegaDevice, SameMotionAsTheMechanicsInside) {
  const std::uint64_t seed = 401;
  OmegaTwinConfig c;
  c.hand_stiffness_N_per_m = 0;
  Rig rig("manual_clock = true\n[twin]\nhand_stiffness_N_per_m = 0\n");
  rt::Startup startup;
  OmegaTwin direct(startup.token(), c, nullptr);
  // The library's twin started its clock at reset, one tick before the driver's first read.
  rt::Time t = rt::time_from_ns(1'000'000'000);
  StylusSample s;
  ASSERT_TRUE(direct.sense(t, s));
  rig.device->request_enable();
  rt::Random random(seed);
  Vec3 f = Vec3::Zero();
  for (int i = 0; i < 800; ++i) {
    t += 1ms;
    if (i == 0) {
      ASSERT_TRUE(direct.enable_force(t));
    }
    ASSERT_TRUE(direct.sense(t, s));
    if (i % 20 == 0) {
      f = Vec3(random.uniform(-1.5, 1.5), random.uniform(-1.5, 1.5), random.uniform(-1.5, 1.5));
    }
    const Vec3 pull = f - 60 * s.p_DH;
    direct.act(t, {pull});
    rig.tick(pull);
    ASSERT_TRUE(rig.sensed);
    ASSERT_EQ(rig.sample.p_DH, s.p_DH) << "tick " << i << " seed " << seed;
    ASSERT_EQ(rig.sample.state, s.state);
  }
  EXPECT_GT(s.p_DH.norm(), 1e-4);
}

// ---- states

TEST(OmegaDevice, ForcesStartOnlyWhenAsked) {
  Rig rig;
  rig.ticks(50, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kIdle);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(rig.twin.truth(), Vec3::Zero());
  EXPECT_EQ(rig.twin.sent(), Vec3::Zero());  // zero commands keep the watchdog fed
  EXPECT_EQ(rig.twin.get("commands"), 50);
  rig.enable();
  rig.ticks(20, {1, 0, 0});
  EXPECT_EQ(rig.twin.motor(), Vec3(1, 0, 0));
  EXPECT_GT(rig.sample.p_DH.x(), 1e-4);
}

TEST(OmegaDevice, ResetNeedsCalibration) {
  Rig rig("manual_clock = true\n[twin]\ncalibrated = false\n");
  rig.device->request_enable();
  rig.ticks(30, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  rig.twin.set("calibrate", 1);
  rig.ticks(12);
  EXPECT_EQ(rig.sample.state, DeviceState::kIdle);
  rig.enable();
}

TEST(OmegaDevice, LostCalibrationIsReset) {
  Rig rig;
  rig.enable();
  rig.twin.set("lose_calibration", 1);
  rig.ticks(12, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(rig.device->counters().force_offs, 1U);
}

TEST(OmegaDevice, ForceButtonBrakesAndEnableReturns) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  rig.twin.set("force_button", 1);
  rig.ticks(12, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kButton);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(rig.twin.sent(), Vec3::Zero());  // nothing waits for the button's second press
  rig.enable();
  rig.ticks(2, {1, 0, 0});
  EXPECT_EQ(rig.twin.motor(), Vec3(1, 0, 0));
}

TEST(OmegaDevice, OverSpeedBrakesByTheController) {
  Rig rig;
  rig.enable();
  rig.twin.set("push_x", 1.5);
  rig.ticks(12);
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kVelocity);
}

TEST(OmegaDevice, StalledLoopIsDroppedWithinTwentyMilliseconds) {
  for (const double watchdog_s : {0.020, 0.005}) {
    OmegaConfig c = quick_config();
    c.watchdog_s = watchdog_s;
    Rig rig(kIdeal, c);
    EXPECT_EQ(rig.twin.get("watchdog_units"), watchdog_s / 125e-6);
    rig.enable();
    rig.ticks(5, {1, 0, 0});
    int held = 0;
    for (; held < 100; ++held) {  // reads go on, commands do not
      rig.tick(Vec3::Zero(), false);
      if (rig.twin.motor() == Vec3::Zero()) break;
    }
    EXPECT_LE(held, watchdog_s * 1e3 + 1);
    EXPECT_GE(held, watchdog_s * 1e3 - 2);
    EXPECT_EQ(rig.twin.cause(), ForceOffCause::kWatchdog);
    rig.ticks(12);
    EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
    EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kWatchdog);
  }
}

TEST(OmegaDevice, LostCommandsMeetTheWatchdog) {
  Rig rig;
  rig.enable();
  rig.twin.set("drop_commands", 15);
  rig.ticks(30, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kForce);
  rig.twin.set("drop_commands", 40);
  rig.ticks(35, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
}

TEST(OmegaDevice, MakeSafeFromAnotherThread) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  const double commands = rig.twin.get("commands");
  std::thread([&] { rig.device->make_safe(); }).join();
  rig.tick({1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);  // at once, whatever the status says
  EXPECT_EQ(rig.twin.get("commands"), commands);     // and nothing is sent any more
  ASSERT_TRUE(rig.wait_until([&] { return rig.device->counters().stops == 1; }));
  EXPECT_EQ(rig.twin.state(), DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  rig.enable();
}

// The owner hangs inside the SDK: another thread makes safe and is not held up.
TEST(OmegaDevice, MakeSafeWhileTheOwnerHangs) {
  Rig rig("[twin]\nhand_stiffness_N_per_m = 0\n");  // real clock
  rig.twin.set("hang_s", 0.3);
  std::atomic<bool> in{false}, out{false};
  std::thread owner([&] {
    in = true;
    (void)rig.device->sense(rig.now, rig.sample);
    out = true;
  });
  while (!in) std::this_thread::yield();
  rig.device->make_safe();
  EXPECT_FALSE(out);  // returned while the owner was still inside
  owner.join();
  rig.twin.set("hang_s", 0);
  const double commands = rig.twin.get("commands");
  rig.device->act(rig.now, {Vec3(1, 0, 0)});
  EXPECT_EQ(rig.twin.get("commands"), commands);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  // A 300 ms exchange is over any bound.
  EXPECT_GE(rig.device->exchange_times().over_bound(), 1U);
}

// ---- what is read

TEST(OmegaDevice, TimeGuardRepeatsAreCounted) {
  OmegaConfig c = quick_config();
  c.time_guard_us = 3500;  // three of four reads at 1 kHz are too near
  Rig rig(kIdeal, c);
  rig.twin.set("push_x", 0.1);
  int fresh = 0;
  double last = -1;
  for (int i = 0; i < 400; ++i) {
    rig.tick();
    ASSERT_TRUE(rig.sensed);
    if (rig.sample.repeated) {
      ASSERT_EQ(rig.sample.p_DH.x(), last);
    } else {
      ++fresh;
    }
    last = rig.sample.p_DH.x();
  }
  EXPECT_NEAR(fresh, 100, 2);
  EXPECT_EQ(rig.device->counters().repeats, 400U - static_cast<unsigned>(fresh));
  EXPECT_EQ(rig.sample.seq, static_cast<unsigned>(fresh));
}

TEST(OmegaDevice, FaultsOfTheReading) {
  Rig rig("manual_clock = true\n[twin]\nhand_stiffness_N_per_m = 0\ncoulomb_N = 0\n");
  rig.enable();
  rig.twin.set("push_y", 0.2);
  rig.ticks(20);
  // Quantum of 10 um on every axis.
  const double steps = rig.sample.p_DH.y() / 1e-5;
  EXPECT_NEAR(steps, std::round(steps), 1e-6);
  EXPECT_GT(rig.sample.p_DH.y(), 1e-3);
  const Vec3 before = rig.sample.p_DH;
  rig.twin.set("repeat", 2);
  rig.ticks(2);
  EXPECT_TRUE(rig.sample.repeated);
  EXPECT_EQ(rig.sample.p_DH, before);
  rig.twin.set("frozen", 1);
  rig.tick();
  const Vec3 frozen = rig.sample.p_DH;
  rig.ticks(20);
  EXPECT_EQ(rig.sample.p_DH, frozen);
  EXPECT_FALSE(rig.sample.repeated);
  rig.twin.set("frozen", 0);
  rig.twin.set("jump_z_m", 0.01);
  rig.tick();
  EXPECT_NEAR(rig.sample.p_DH.z(), 0.01, 1e-5);
  rig.twin.set("stuck_button", 1);
  rig.tick();
  EXPECT_TRUE(rig.sample.button);
  rig.twin.set("nan_position", 1);
  rig.tick();
  EXPECT_TRUE(rig.sensed);  // the task judges it: its fault, its reaction
  EXPECT_TRUE(std::isnan(rig.sample.p_DH.x()));
}

TEST(OmegaDevice, MotorOffsetIsTheHandsToFeel) {
  Rig rig;
  rig.enable();
  rig.twin.set("bias_x_N", 0.5);
  rig.ticks(100);
  EXPECT_GT(rig.sample.p_DH.x(), 0.005);
}

TEST(OmegaDevice, ASingleFailedExchangeIsNoLoss) {
  Rig rig;
  rig.enable();
  rig.twin.set("fail_calls", 1);
  rig.tick({1, 0, 0});
  EXPECT_FALSE(rig.sensed);
  rig.tick({1, 0, 0});
  EXPECT_TRUE(rig.sensed);
  EXPECT_EQ(rig.sample.state, DeviceState::kForce);
  EXPECT_EQ(rig.device->counters().losses, 0U);
  EXPECT_EQ(rig.device->counters().failures, 1U);
}

// ---- unplug

TEST(OmegaDevice, UnpluggedInContactGoesLimpAndComesBack) {
  Rig rig;
  rig.enable();
  // A wall at 2 mm that the outside presses on with 2 N: in contact, force on the hand.
  rig.twin.set("external_x_N", 2.0);
  const auto wall = [&] {
    const double depth = rig.sample.p_DH.x() - 0.002;
    return Vec3(depth > 0 ? -800 * depth : 0, 0, 0);
  };
  for (int i = 0; i < 2000; ++i) rig.tick(rig.sensed ? wall() : Vec3::Zero());
  ASSERT_NEAR(rig.twin.motor().x(), -2.0, 0.1);

  rig.twin.set("unplugged", 1);
  const double commands = rig.twin.get("commands");
  for (int i = 0; i < 5; ++i) {
    rig.tick(wall());
    EXPECT_FALSE(rig.sensed);
    EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  }
  EXPECT_EQ(rig.twin.get("commands"), commands);
  EXPECT_FALSE(rig.device->connected());
  EXPECT_EQ(rig.device->counters().losses, 1U);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kDisconnect);
  std::this_thread::sleep_for(30ms);  // some tries to open meanwhile
  rig.tick(wall());
  EXPECT_FALSE(rig.sensed);

  rig.twin.set("unplugged", 0);
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  EXPECT_EQ(rig.device->counters().reopened, 1U);
  // It reads again; forces wait for the operator's act, though the task asks for them.
  for (int i = 0; i < 50; ++i) rig.tick({-1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(rig.twin.get("watchdog_units"), 160);
  rig.enable();
  rig.ticks(3, {-1, 0, 0});
  EXPECT_EQ(rig.twin.motor(), Vec3(-1, 0, 0));
}

TEST(OmegaDevice, ManyPlugsAndUnplugs) {
  Rig rig;
  for (unsigned i = 1; i <= 20; ++i) {
    rig.twin.set("unplugged", 1);
    rig.ticks(4);
    ASSERT_FALSE(rig.sensed);
    rig.twin.set("unplugged", 0);
    ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
    ASSERT_EQ(rig.device->counters().losses, i);
    ASSERT_EQ(rig.device->counters().reopened, i);
  }
}

TEST(OmegaDevice, EndsWhileUnplugged) {
  Rig rig;
  rig.twin.set("unplugged", 1);
  rig.ticks(5);
  rig.device.reset();
  EXPECT_EQ(rig.twin.get("open"), 0);
}

TEST(OmegaDevice, ClosingStopsTheMotors) {
  Rig rig;
  rig.enable();
  rig.ticks(3, {1, 0, 0});
  rig.device.reset();
  EXPECT_EQ(rig.twin.state(), DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(rig.twin.get("open"), 0);
}

// ---- forces

TEST(OmegaDevice, WeightAndCommandShareTheLimit) {
  const std::uint64_t seed = 402;
  Rig rig(
      "manual_clock = true\n[twin]\ncoulomb_N = 0\ngravity_mass_kg = 0.4\nhand_mass_kg = 5\n"
      "mass_kg = 5\nspeed_limit_m_per_s = 20\nhand_stiffness_N_per_m = 0\n");
  rig.enable();
  rt::Random random(seed);
  const Vec3 weight(0, 0, 0.4 * 9.81);
  double largest = 0;
  for (int i = 0; i < 500; ++i) {
    const Vec3 f(random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(-20, 20));
    rig.tick(f);
    rig.tick(f);  // in force
    const double sum = rig.twin.motor().norm();
    largest = std::max(largest, sum);
    ASSERT_LE(sum, 12.0 + 1e-9) << "seed " << seed;
    const Vec3 hand = rig.twin.motor() - weight;
    ASSERT_LT(hand.cross(f).norm(), 1e-9 * f.norm() * 12) << "direction kept";
    ASSERT_GE(hand.dot(f), -1e-9);
  }
  EXPECT_GT(largest, 11.9);
  EXPECT_EQ(rig.device->counters().saturated, 0U);
}

// Against a search along the ray.
TEST(OmegaDevice, LimitedBesideIsTheLargestThatFits) {
  const std::uint64_t seed = 403;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    const auto any = [&](double r) {
      return Vec3(random.uniform(-r, r), random.uniform(-r, r), random.uniform(-r, r));
    };
    const Vec3 f = any(30), w = any(7);
    const double limit = random.uniform(1, 15);
    const Vec3 got = drivers::limited_beside(f, w, limit);
    if (w.norm() >= limit) {
      ASSERT_EQ(got, Vec3::Zero());
      continue;
    }
    double lo = 0, hi = 1;
    if ((w + f).norm() <= limit) {
      lo = 1;
    } else {
      for (int n = 0; n < 60; ++n) {
        const double mid = 0.5 * (lo + hi);
        ((w + mid * f).norm() <= limit ? lo : hi) = mid;
      }
    }
    ASSERT_LT((got - lo * f).norm(), 1e-9) << "seed " << seed << " case " << i;
  }
}

TEST(OmegaDevice, NotANumberIsRefused) {
  Rig rig;
  rig.enable();
  rig.tick({1, 0, 0});
  rig.tick({std::numeric_limits<double>::quiet_NaN(), 0, 0});
  rig.tick({std::numeric_limits<double>::infinity(), 0, 0});
  EXPECT_EQ(rig.twin.sent(), Vec3::Zero());
  EXPECT_EQ(rig.device->counters().refused_commands, 2U);
  EXPECT_EQ(rig.twin.state(), DeviceState::kForce);
}

TEST(OmegaDevice, VelocityThresholdIsLeftOn) {
  Rig rig;
  const double before = rig.twin.get("velocity_threshold");
  rig.enable();
  rig.ticks(10);
  EXPECT_GT(before, 0);
  EXPECT_EQ(rig.twin.get("velocity_threshold"), before);
}

TEST(OmegaDevice, NoAllocationInTheTick) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  Rig rig;
  rig.enable();
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 200; ++i) {
      rig.now += 1ms;
      (void)rig.device->sense(rig.now, rig.sample);
      rig.device->act(rig.now, {Vec3(0.1, 0, 0)});
    }
  }
  // Locks are the SDK's own (the twin's mutex); the driver adds none: as many as calls of the SDK.
  EXPECT_EQ(rt_guard::counts().allocations, 0U);
  EXPECT_EQ(rt_guard::counts().frees, 0U);
  EXPECT_EQ(rt_guard::counts().throws, 0U);
  EXPECT_EQ(rt_guard::counts().waits, 0U);
}

TEST(OmegaDevice, ExchangeHistogramAgainstSorting) {
  const std::uint64_t seed = 404;
  rt::Random random(seed);
  drivers::ExchangeHistogram h(100'000);
  std::vector<std::int64_t> all;
  std::uint64_t over = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto v = static_cast<std::int64_t>(std::exp(random.uniform(0, 15)));
    all.push_back(v);
    over += v > 100'000;
    h.add(v);
  }
  std::sort(all.begin(), all.end());
  for (const std::size_t hundredths : {0U, 10U, 50U, 90U, 99U, 100U}) {
    const double q = static_cast<double>(hundredths) / 100;
    const auto rank = std::max<std::size_t>(1, (hundredths * all.size() + 99) / 100);
    const auto exact = all[rank - 1];
    EXPECT_GE(h.quantile_ns(q), exact);
    EXPECT_LE(static_cast<double>(h.quantile_ns(q)), 1.25 * static_cast<double>(exact) + 1);
  }
  EXPECT_EQ(h.over_bound(), over);
  EXPECT_EQ(h.max_ns(), all.back());
  EXPECT_EQ(h.count(), all.size());
}

}  // namespace
