// The device as its user sees it: position, force, states.
#include <array>
#include <limits>

#include "rt/memory/section.hpp"
#include "tests/unit/drivers_falcon/device_rig.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

// ---- position and force

TEST(FalconDevice, ReadsWhereTheGripIs) {
  for (const Vec3& at : {Vec3(0, 0, 0), Vec3(0.03, -0.02, 0.01), Vec3(-0.04, 0.01, -0.02)}) {
    Rig rig(ready_twin(), quick_config(), at);
    rig.ticks(5);
    ASSERT_TRUE(rig.sensed);
    // Half an encoder step a leg.
    EXPECT_LT((rig.sample.p_DH - at).norm(), 6e-5) << at.transpose();
    EXPECT_EQ(rig.sample.state, DeviceState::kIdle);
  }
}

TEST(FalconDevice, ForceArrivesInSizeAndDirection) {
  for (const Vec3& at : {Vec3(0, 0, 0), Vec3(0.02, 0.02, -0.01)}) {
    FalconTwinConfig heavy = ready_twin();
    heavy.plant.mass_kg = 5;  // stays while the force is looked at
    Rig rig(heavy, quick_config(), at);
    rig.enable();
    for (const Vec3& f : {Vec3(2, 0, 0), Vec3(0, -3, 0), Vec3(0, 0, 1.5), Vec3(1, 1, -1)}) {
      rig.ticks(6, f);
      EXPECT_LT((rig.twin.motor_force_D() - f).norm(), 0.02 * f.norm())
          << rig.twin.motor_force_D().transpose();
    }
  }
}

TEST(FalconDevice, SaturationKeepsTheDirection) {
  FalconConfig c = quick_config();
  c.torque_limit_cnt = 1000;
  FalconTwinConfig heavy = ready_twin();
  heavy.plant.mass_kg = 5;
  Rig rig(heavy, c);
  rig.enable();
  const Vec3 f(5, 3, -4);
  rig.ticks(6, f);
  const Vec3 got = rig.twin.motor_force_D();
  EXPECT_LT(got.norm(), 0.7 * f.norm());
  EXPECT_LT(got.normalized().cross(f.normalized()).norm(), 0.01);
  EXPECT_GT(got.dot(f), 0);
  int most = 0;
  for (const auto t : rig.twin.last_command().torque_cnt) most = std::max<int>(most, std::abs(t));
  EXPECT_EQ(most, 1000);
  EXPECT_GT(rig.device->counters().saturated, 0U);
  rig.ticks(6, 100 * f);  // the force limit goes before
  EXPECT_LE(rig.twin.motor_force_D().norm(), 8.9 * 1.01);
}

TEST(FalconDevice, RunsAtOneKilohertz) {
  Rig rig;
  const auto frames = rig.twin.frames();
  rig.ticks(1000);
  EXPECT_NEAR(static_cast<double>(rig.twin.frames() - frames), 1000, 5);
  EXPECT_EQ(rig.device->counters().kicks, 0U);
}

// From the instant the encoders are read to the instant a torque computed from them is set, over
// all phases of tick against packets: not more than the delay that the device states.
TEST(FalconDevice, StatedDelayHolds) {
  double worst_s = 0;
  for (int phase = 0; phase < 4; ++phase) {
    FalconTwinConfig heavy = ready_twin();
    heavy.plant.mass_kg = 5;
    Rig rig(heavy);
    rig.enable();
    rig.pass(phase * kMs / 4);
    // A force that is a function of the sample: after a slip of the encoders the next force
    // differs.
    for (int trial = 0; trial < 40; ++trial) {
      rig.pass((trial % 4) * kMs / 4);
      rig.twin.faults().slip_cnt = {0, 0, static_cast<std::int16_t>(trial % 2 == 0 ? 40 : 0)};
      const auto answered = rig.twin.frames();
      std::int64_t sampled = 0;
      const auto before = rig.twin.last_command().torque_cnt;
      for (int quarter = 0; quarter < 60; ++quarter) {
        rig.pass(kMs / 4);
        if (sampled == 0 && rig.twin.frames() > answered) sampled = rig.twin.exchange_ns();
        if (quarter % 4 == 3) {
          (void)rig.device->sense(rt::time_from_ns(rig.now_ns), rig.sample);
          rig.device->act(rt::time_from_ns(rig.now_ns), {-300 * rig.sample.p_DH});
        }
        const auto now = rig.twin.last_command().torque_cnt;
        int change = 0;
        for (std::size_t i = 0; i < 3; ++i) change = std::max(change, std::abs(now[i] - before[i]));
        if (sampled != 0 && change > 20) {
          worst_s = std::max(worst_s, static_cast<double>(rig.twin.exchange_ns() - sampled) * 1e-9);
          break;
        }
      }
    }
  }
  std::printf("falcon: sample to force at most %.2f ms\n", worst_s * 1e3);
  EXPECT_GT(worst_s, 1e-3);
  EXPECT_LE(worst_s, FalconConfig{}.delay_s);
}

TEST(FalconDevice, DelayCountsInTheStiffnessLimit) {
  Rig rig;
  const auto p = rig.device->properties();
  EXPECT_NEAR(p.stiffness_limit(1e-3), 0.8 * 2 / (0.0005 + 0.0025), 1e-9);  // 533 N/m
}

// ---- states

void once_out_and_in(Rig& rig) {
  rig.push({-0.6, 0, 0});
  rig.ticks(150);
  rig.push({0.9, 0, 0});
  rig.ticks(150);
  rig.push({-0.5, 0, 0});
  rig.ticks(200);
}

TEST(FalconDevice, ResetUntilTheHandHasShownTheMarks) {
  FalconTwinConfig c = ready_twin();
  c.homed = false;
  Rig rig(c);
  rig.ticks(20, {1, 0, 0});
  EXPECT_TRUE(rig.sensed);
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
  EXPECT_TRUE(rig.twin.last_command().red);
  EXPECT_TRUE(rig.twin.last_command().home);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  once_out_and_in(rig);
  EXPECT_EQ(rig.sample.state, DeviceState::kIdle);  // forces want an act
  EXPECT_FALSE(rig.twin.last_command().home);
  EXPECT_TRUE(rig.twin.last_command().green);
  EXPECT_LT((rig.sample.p_DH - rig.twin.plant().true_position()).norm(), 2e-4);
  rig.enable();
  rig.ticks(4);
  EXPECT_TRUE(rig.twin.last_command().blue);
}

// The start of a run asks before the hand has moved the grip.
TEST(FalconDevice, ARequestBeforeTheMarksWaitsForThemUnlessMadeSafe) {
  FalconTwinConfig c = ready_twin();
  c.homed = false;
  for (const bool made_safe : {false, true}) {
    Rig rig(c);
    rig.device->request_enable();
    rig.ticks(20, {1, 0, 0});
    EXPECT_EQ(rig.sample.state, DeviceState::kReset);
    EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
    if (made_safe) rig.device->make_safe();
    once_out_and_in(rig);
    EXPECT_EQ(rig.sample.state, made_safe ? DeviceState::kBrake : DeviceState::kForce);
  }
}

// The owner stalls, is made safe by another thread, and goes on.
TEST(FalconDevice, MakeSafeOvertakesARequestNotYetSeen) {
  Rig rig;
  rig.device->request_enable();
  rig.device->make_safe();
  rig.ticks(10, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.enable();
}

TEST(FalconDevice, MakeSafeAndBack) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  EXPECT_GT(rig.twin.motor_force_D().x(), 0.9);
  std::thread([&] { rig.device->make_safe(); }).join();
  rig.pass(3 * kMs);  // the owner hangs: the event thread alone sends zero
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.ticks(5, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  EXPECT_GT(rig.twin.motor_force_D().x(), 0.9);
}

TEST(FalconDevice, StalledOwnerMeansZeroWithinTwentyMilliseconds) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  int held = 0;
  for (; held < 100; ++held) {
    rig.pass(kMs);
    if (rig.twin.motor_force_D() == Vec3::Zero()) break;
  }
  EXPECT_LE(held, 22);
  EXPECT_GE(held, 18);
  EXPECT_GT(rig.device->counters().starved, 0U);
}

TEST(FalconDevice, OverSpeedBrakes) {
  Rig rig;
  rig.enable();
  rig.push({1.6, 0, 0});
  rig.ticks(8, {0.1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kVelocity);
  rig.ticks(4, {0.1, 0, 0});
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
}

TEST(FalconDevice, NotANumberIsRefused) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {std::numeric_limits<double>::quiet_NaN(), 0, 0});
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  EXPECT_EQ(rig.device->counters().refused_commands, 5U);
}

TEST(FalconDevice, NothingInTheTickAllocatesOrLocks) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  Rig rig;
  rig.enable();
  rig.push({0.1, 0, 0});
  rt_guard::reset();
  for (int i = 0; i < 200; ++i) {
    rig.pass(kMs);
    const rt::Section section;
    (void)rig.device->sense(rt::time_from_ns(rig.now_ns), rig.sample);
    rig.device->act(rt::time_from_ns(rig.now_ns), {Vec3(1, 0, 0)});
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
}  // namespace tests
