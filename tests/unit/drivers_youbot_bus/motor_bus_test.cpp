// The base's wheels through master and virtual chain, held against the virtual robot alone.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "drivers/youbot/virtual_youbot.hpp"
#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::MotorMode;
using drivers::MotorSetpoints;
using drivers::MotorStates;
using drivers::VirtualYoubot;
using drivers::youbot_bus::EtherCatTwinBus;

constexpr double kGear = 9405.0 / 364.0, kTwoPi = 2 * std::numbers::pi;
constexpr double kRadPerTick = kTwoPi / (4000 * kGear);

double rad_per_s(double rpm) { return rpm * kTwoPi / 60 / kGear; }

struct WheelsRig {
  explicit WheelsRig(rt::Time first = rt::time_from_ns(1'000'000'000'000))
      : now(first - 1ms), bus(startup.token(), robot) {}
  BusStatus job(double rpm, MotorMode mode = MotorMode::kVelocity) {
    now += 1ms;
    MotorSetpoints s{mode, {}};
    s.wheel_rad_per_s.fill(rad_per_s(rpm));
    return bus.exchange(now, s, states);
  }
  rt::Startup startup;
  VirtualYoubot robot{startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  rt::Time now;
  EtherCatTwinBus bus;
  MotorStates states;
};

// Setpoints that are whole rpm pass unchanged, so both robots do the same; the encoder's words
// round down to a tick. Box clocks that begin at zero, and far from it.
TEST(EtherCatMotorBus, SameMotionAsWithoutABus) {
  for (const std::int64_t begin_s : {0, 1000}) {
    const rt::Time first = rt::time_from_ns(begin_s * 1'000'000'000);
    WheelsRig rig(first);
    rt::Startup startup;
    VirtualYoubot direct{startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
    MotorStates expected;
    rt::Random random(9);
    double rpm = 0;
    for (int i = 0; i < 3000; ++i) {
      if (i % 100 == 0) rpm = static_cast<double>(random.integer(-2000, 2000));
      const auto last = rig.states.seq;
      ASSERT_EQ(rig.job(rpm), BusStatus::kOk) << i;
      ASSERT_TRUE(i == 0 || rig.states.seq == last + 1) << i;
      MotorSetpoints s{MotorMode::kVelocity, {}};
      s.wheel_rad_per_s.fill(rad_per_s(rpm));
      ASSERT_EQ(direct.exchange(rig.now, s, expected), BusStatus::kOk);
      for (std::size_t w = 0; w < 4; ++w) {
        ASSERT_NEAR(rig.states.wheel_rad[w], expected.wheel_rad[w], 1.01 * kRadPerTick) << i;
        ASSERT_NEAR(rig.states.wheel_rad_per_s[w], expected.wheel_rad_per_s[w], rad_per_s(0.51));
        ASSERT_NEAR(rig.states.current_A[w], expected.current_A[w], 0.00051);
      }
      ASSERT_EQ(rig.states.taken, rig.now);
    }
    EXPECT_EQ(rig.bus.master().counters().lost, 0U);
  }
}

TEST(EtherCatMotorBus, AllocatesNothing) {
  WheelsRig rig;
  for (int i = 0; i < 10; ++i) (void)rig.job(100);
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 500; ++i) {
      if (i == 200) rig.bus.make_safe();
      if (i == 250) rig.bus.rearm();
      (void)rig.job(100);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

// A silence of 200 ms: slaves fall, the bus is down, and nothing moves until it is rearmed; then
// the first setpoint is the first motion.
TEST(EtherCatMotorBus, SilenceStopsAndOnlyRearmingRecovers) {
  WheelsRig rig;
  for (int i = 0; i < 500; ++i) (void)rig.job(600);
  EXPECT_NEAR(rig.states.wheel_rad_per_s[0], rad_per_s(600), rad_per_s(2));
  rig.now += 200ms;
  EXPECT_EQ(rig.job(600), BusStatus::kDown);
  for (int i = 0; i < 300; ++i) EXPECT_EQ(rig.job(600), BusStatus::kDown);
  EXPECT_LT(std::abs(rig.robot.plant().state().wheel_rad_per_s[0]), 1e-3);
  // Slaves in SAFEOP still tell what the wheels do.
  for (std::size_t w = 0; w < 4; ++w) {
    EXPECT_LT(std::abs(rig.states.wheel_rad_per_s[w]), 1e-3);
    EXPECT_NEAR(rig.states.wheel_rad[w], rig.robot.plant().state().wheel_rad[w],
                1.01 * kRadPerTick);
  }
  EXPECT_EQ(rig.states.taken, rig.now);
  rig.bus.rearm();
  int jobs = 0;
  for (; jobs < 1000 && rig.job(0, MotorMode::kStop) != BusStatus::kOk; ++jobs) {
  }
  for (int i = 0; i < 100; ++i) ASSERT_EQ(rig.job(0, MotorMode::kStop), BusStatus::kOk);
  for (const auto f : rig.states.flags) EXPECT_EQ(f & (1U << 16U), 0U);
  EXPECT_LT(std::abs(rig.robot.plant().state().wheel_rad_per_s[0]), 1e-3);
  for (int i = 0; i < 300; ++i) ASSERT_EQ(rig.job(300), BusStatus::kOk);
  EXPECT_NEAR(rig.states.wheel_rad_per_s[0], rad_per_s(300), rad_per_s(2));
}

TEST(EtherCatMotorBus, LostFramesAndSafety) {
  WheelsRig rig;
  for (int i = 0; i < 300; ++i) (void)rig.job(600);
  const auto before = rig.states;
  rig.bus.port().faults().lose_back = 1;
  EXPECT_EQ(rig.job(600), BusStatus::kFrameLost);
  EXPECT_EQ(rig.states.seq, before.seq) << "states keep what they had";
  rig.bus.port().faults().wrong_counter = 1;
  EXPECT_EQ(rig.job(600), BusStatus::kFrameLost);
  rig.robot.faults().lose_frames = 1;
  EXPECT_EQ(rig.job(600), BusStatus::kFrameLost) << "the robot's own faults pass";
  EXPECT_EQ(rig.job(600), BusStatus::kOk);
  rig.bus.chain().emergency_stop();
  EXPECT_EQ(rig.job(600), BusStatus::kDown);
  rig.bus.chain().wire().cut_behind(5);
  EXPECT_EQ(rig.job(600), BusStatus::kOk);
  rig.bus.make_safe();
  (void)rig.job(600);
  for (const std::size_t slave : {1U, 2U, 3U, 4U}) {
    const auto out = rig.bus.master().outputs(slave);
    for (const auto b : out) EXPECT_EQ(b, 0) << "motor stop in the first frame after it";
  }
}

// What is no speed is motor stop on the wire.
TEST(EtherCatMotorBus, NoSpeedNoMotion) {
  WheelsRig rig;
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e12}) {
    (void)rig.job(bad);
    for (const auto b : rig.bus.master().outputs(1)) EXPECT_EQ(b, 0);
  }
}

}  // namespace
}  // namespace tests
