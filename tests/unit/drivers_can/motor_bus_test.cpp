// The base's wheels on a simulated CAN bus, held against the virtual robot alone; and every fault
// of the bus: what it does, how it ends.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "drivers/can/twin/can_twin_bus.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::MotorMode;
using drivers::MotorSetpoints;
using drivers::MotorStates;
using drivers::VirtualYoubot;
using drivers::can::BusState;
using drivers::can::CanMotorConfig;
using drivers::can::CanTwinBus;
using drivers::can::PortState;

constexpr double kGear = 9405.0 / 364.0, kTwoPi = 2 * std::numbers::pi;
double rad_per_s(double rpm) { return rpm * kTwoPi / 60 / kGear; }

struct Rig {
  BusStatus job(double rpm, MotorMode mode = MotorMode::kVelocity) {
    now += 1ms;
    MotorSetpoints s{mode, {}};
    s.wheel_rad_per_s.fill(rad_per_s(rpm));
    return last = bus.exchange(now, s, states);
  }
  int jobs(int n, double rpm, MotorMode mode = MotorMode::kVelocity) {
    int ok = 0;
    for (int i = 0; i < n; ++i) ok += job(rpm, mode) == BusStatus::kOk ? 1 : 0;
    return ok;
  }
  [[nodiscard]] double true_speed() const { return robot.plant().state().wheel_rad_per_s[0]; }
  rt::Startup startup;
  VirtualYoubot robot{startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  CanTwinBus bus{startup.token(), robot};
  MotorStates states;
  BusStatus last = BusStatus::kOk;
};

TEST(CanMotorBus, DrivesAndReportsWhatTheRobotDoes) {
  Rig r;
  r.jobs(10, 0);
  rt::Random random(9);
  double rpm = 0;
  int ok = 0;
  constexpr double kTick = kTwoPi / (4000 * kGear);
  for (int i = 0; i < 3000; ++i) {
    if (i % 300 == 0) rpm = static_cast<double>(random.integer(-2000, 2000));
    const auto& truth = r.robot.plant().state();
    ok += r.job(rpm) == BusStatus::kOk ? 1 : 0;
    if (i % 300 < 250) continue;
    for (std::size_t w = 0; w < 4; ++w) {
      // Positions are up to nine jobs old, at a speed that stands.
      ASSERT_NEAR(r.states.wheel_rad[w], truth.wheel_rad[w],
                  10e-3 * std::abs(rad_per_s(rpm)) + 2 * kTick)
          << i;
      ASSERT_NEAR(r.states.wheel_rad_per_s[w], rad_per_s(rpm), rad_per_s(3)) << i;
      ASSERT_NEAR(truth.wheel_rad_per_s[w], rad_per_s(rpm), rad_per_s(3)) << i;
    }
  }
  EXPECT_EQ(ok, 3000);
  EXPECT_EQ(r.bus.bus().counters().late, 0U);
  EXPECT_EQ(r.bus.bus().counters().strange, 0U);
  EXPECT_EQ(r.bus.bus().counters().refused, 0U);
  EXPECT_LE(r.now - r.states.taken, 9ms);
  const double load = rt::seconds(r.bus.port().busy()) / 3.01;
  std::printf("load of a bus of 1 Mbit/s: %.2f\n", load);
  EXPECT_LT(load, 0.8);
}

// Over the whole range of the encoder's word: it wraps, the angle does not.
TEST(CanMotorBus, AnglesDoNotWrap) {
  rt::Startup startup;
  drivers::can::TmclModule module;
  std::vector<drivers::can::TmclModule> modules(4);
  CanMotorConfig c;
  for (std::size_t i = 0; i < 4; ++i) {
    modules[i].id = static_cast<std::uint32_t>(c.request_ids[i]);
    modules[i].address = static_cast<std::uint8_t>(c.module_addresses[i]);
  }
  drivers::can::CanTwinPort port(startup.token(), modules);
  drivers::can::CanMotorBus bus(startup.token(), port, c);
  MotorStates states;
  rt::Time now = rt::time_from_ns(1'000'000'000);
  std::int64_t ticks = INT32_MAX - 5000;
  double last = 0;
  for (int i = 0; i < 200; ++i) {
    for (auto& m : port.modules()) m.position = static_cast<std::int32_t>(ticks);
    now += 1ms;
    if (bus.exchange(now, {}, states) == BusStatus::kOk) {
      if (last != 0) {
        ASSERT_LT(std::abs(states.wheel_rad[0] - last), 0.1);
      }
      last = states.wheel_rad[0];
    }
    ticks += 100;
  }
  EXPECT_NEAR(last, (INT32_MAX - 5000.0 + 19500) * kTwoPi / (4000 * kGear), 0.1);
}

TEST(CanMotorBus, MotorStopIsOnTheWireInTheSameJob) {
  Rig r;
  r.jobs(300, 600);
  for (int after = 0; after < 8; ++after) {
    r.jobs(50 + after, 600);
    ASSERT_TRUE(r.bus.port().modules()[0].turning);
    (void)r.job(600, MotorMode::kStop);
    r.bus.port().advance(r.now + 1ms);  // the wire's time for four frames
    for (const auto& m : r.bus.port().modules()) EXPECT_FALSE(m.turning) << after;
    r.jobs(20, 0, MotorMode::kStop);
  }
  EXPECT_EQ(r.bus.bus().counters().refused, 0U);
}

TEST(CanMotorBus, AllocatesNothing) {
  Rig r;
  r.jobs(20, 100);
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 500; ++i) {
      if (i == 200) r.bus.make_safe();
      if (i == 250) r.bus.rearm();
      (void)r.job(100);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

TEST(CanMotorBus, NoSpeedNoMotion) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e12}) {
    Rig r;
    r.jobs(100, 300);
    r.jobs(5, bad);
    for (const auto& m : r.bus.port().modules()) EXPECT_FALSE(m.turning);
  }
}

TEST(CanMotorBus, MakeSafeStopsAtOnceAndHolds) {
  Rig r;
  r.jobs(300, 600);
  r.bus.make_safe();
  r.bus.port().advance(r.now);
  for (const auto& m : r.bus.port().modules()) EXPECT_FALSE(m.turning) << "without a job";
  r.jobs(200, 600);
  EXPECT_LT(std::abs(r.true_speed()), 1e-3);
  r.bus.rearm();
  r.jobs(300, 600);
  EXPECT_NEAR(r.true_speed(), rad_per_s(600), rad_per_s(3));
}

TEST(CanMotorBus, TwoModulesOfOneAddressAreRefused) {
  rt::Startup startup;
  drivers::can::CanTwinPort port(startup.token(), {});
  CanMotorConfig c;
  c.request_ids[3] = c.request_ids[0];
  EXPECT_THROW(drivers::can::CanMotorBus(startup.token(), port, c), std::invalid_argument);
  c = {};
  c.module_addresses[2] = c.module_addresses[1];
  EXPECT_THROW(drivers::can::CanMotorBus(startup.token(), port, c), std::invalid_argument);
}

// ---- faults

TEST(CanFaults, ALostReplyIsOneLostFrame) {
  Rig r;
  r.jobs(100, 300);
  const auto before = r.states;
  r.bus.port().faults().lose_replies = 1;
  int lost = 0;
  for (int i = 0; i < 20; ++i) lost += r.job(300) == BusStatus::kFrameLost ? 1 : 0;
  EXPECT_EQ(lost, 1);
  EXPECT_EQ(r.bus.bus().counters().late, 1U);
  EXPECT_GT(r.states.seq, before.seq);
  EXPECT_EQ(r.last, BusStatus::kOk);
}

// A late reply must not pass for the next one's: values stay what they are.
TEST(CanFaults, RepliesLateTwiceOrLostNeverMixUpWhatTheyAreOf) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Rig r;
    rt::Random random(seed, 8);
    r.jobs(400, 700);
    int delayed_until = 0;
    for (int i = 0; i < 3000; ++i) {
      auto& f = r.bus.port().faults();
      const double what = random.uniform();
      if (what < 0.01) f.lose_replies = static_cast<int>(random.integer(1, 6));
      if (what > 0.99) f.double_replies = static_cast<int>(random.integer(1, 6));
      if (what > 0.5 && what < 0.51) {
        f.delay_replies = rt::Nanos{random.integer(0, 12'000'000)};
        delayed_until = i + static_cast<int>(random.integer(1, 40));
      }
      if (i >= delayed_until) f.delay_replies = rt::Nanos{0};
      if (what > 0.6 && what < 0.61) f.corrupt = 2;
      const double before = r.states.wheel_rad[0];
      const bool had = r.states.seq > 0;
      (void)r.job(700);
      if (r.last == BusStatus::kDown) {  // too long without a position
        f = {};
        r.jobs(100, 700);
        r.bus.rearm();
        r.jobs(600, 700);
        continue;
      }
      if (had) {
        ASSERT_LT(std::abs(r.states.wheel_rad[0] - before), rad_per_s(700) * 0.2)
            << "seed " << seed << " job " << i;
      }
      ASSERT_NEAR(r.states.wheel_rad_per_s[0], rad_per_s(700), rad_per_s(5))
          << "seed " << seed << " job " << i;
    }
  }
}

TEST(CanFaults, ASilentModuleIsABusThatIsDownUntilRearmed) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().modules()[2].silent = true;
  int job = 0;
  while (r.job(300) != BusStatus::kDown && job < 500) ++job;
  EXPECT_NEAR(job, 100, 5);
  r.bus.port().modules()[2].silent = false;
  EXPECT_EQ(r.jobs(100, 300), 0) << "latched";
  for (const auto& m : r.bus.port().modules()) EXPECT_FALSE(m.turning && m.id != 5);
  r.jobs(300, 300);
  EXPECT_LT(std::abs(r.true_speed()), 1e-3);
  r.bus.rearm();
  EXPECT_GT(r.jobs(100, 300), 80);
}

TEST(CanFaults, BusOffIsLatchedAndPositionsAreReadBeforeMotion) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().bus_off();
  EXPECT_EQ(r.job(300), BusStatus::kDown) << "in the same job";
  EXPECT_EQ(r.bus.port().bus_state(), BusState::kBusOff);
  r.jobs(50, 300);
  r.bus.port().restart();
  EXPECT_EQ(r.jobs(50, 300), 0) << "the controller is back: no motion without an act";
  for (auto& m : r.bus.port().modules()) m.turning = false;
  const auto requests = r.bus.port().modules()[0].requests;
  r.bus.rearm();
  int job = 0;
  while (r.job(300) != BusStatus::kOk && job < 100) {
    ++job;
    for (const auto& m : r.bus.port().modules()) ASSERT_FALSE(m.turning) << job;
  }
  EXPECT_LT(job, 12);
  EXPECT_GT(r.bus.port().modules()[0].requests, requests);
  r.jobs(200, 300);
  EXPECT_NEAR(r.true_speed(), rad_per_s(300), rad_per_s(3));
  EXPECT_EQ(r.bus.port().counters().bus_offs, 1U);
  EXPECT_EQ(r.bus.port().counters().restarts, 1U);
}

// restart-ms brings a controller back by itself, maybe before a job has looked.
TEST(CanFaults, BusOffAndBackBetweenTwoJobsIsLatchedToo) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().bus_off();
  r.bus.port().restart();
  EXPECT_EQ(r.job(300), BusStatus::kDown);
  EXPECT_EQ(r.jobs(50, 300), 0);
  for (const auto& m : r.bus.port().modules()) EXPECT_FALSE(m.turning);
  r.bus.rearm();
  EXPECT_GT(r.jobs(100, 300), 80);
}

// Nobody acknowledges: the queue fills, nothing stale is kept, and after 20 jobs the bus is down.
TEST(CanFaults, AFullQueueIsCountedThenDown) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().faults().cable_cut = true;
  int job = 0;
  while (r.job(300) != BusStatus::kDown && job < 500) ++job;
  EXPECT_LT(job, 60);
  EXPECT_GT(r.bus.port().counters().refused, 0U);
  EXPECT_GT(r.bus.port().counters().no_acks, 0U);
  EXPECT_EQ(r.bus.port().state(), PortState::kQueueFull);
  // The modules kept their last setpoint all the while: that is what the relay is for.
  EXPECT_TRUE(r.bus.port().modules()[0].turning);
  r.bus.port().faults().cable_cut = false;
  r.jobs(8, 300);
  for (const auto& m : r.bus.port().modules())
    EXPECT_FALSE(m.turning) << "what had waited in the queue is overtaken by motor stop";
  r.jobs(300, 300);
  EXPECT_LT(std::abs(r.true_speed()), 1e-3);
  r.bus.rearm();
  EXPECT_GT(r.jobs(100, 300), 80);
}

TEST(CanFaults, AnInterfaceThatGoesDownAndComesBack) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().faults().interface_down = true;
  EXPECT_EQ(r.job(300), BusStatus::kDown);
  EXPECT_EQ(r.bus.port().state(), PortState::kDown);
  r.jobs(20, 300);
  r.bus.port().faults().interface_down = false;
  EXPECT_EQ(r.jobs(20, 300), 0) << "latched";
  r.bus.rearm();
  EXPECT_GT(r.jobs(100, 300), 80);
}

TEST(CanFaults, ChecksumErrorsOnTheWireAreCountedAndGoAgain) {
  Rig r;
  r.jobs(200, 300);
  r.bus.port().faults().corrupt = 5;
  r.jobs(50, 300);
  EXPECT_EQ(r.bus.port().counters().protocol_errors, 5U);
  EXPECT_EQ(r.last, BusStatus::kOk);
}

TEST(CanFaults, ARefusalIsCountedAndNoState) {
  Rig r;
  r.jobs(200, 300);
  const double angle = r.states.wheel_rad[1];
  r.bus.port().modules()[1].status_instead = 4;
  r.jobs(50, 300);
  EXPECT_GT(r.bus.bus().counters().refused, 10U);
  EXPECT_NEAR(r.states.wheel_rad[1], angle, 0.01) << "a refusal carries no position";
}

}  // namespace
