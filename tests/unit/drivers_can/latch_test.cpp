// What a module has latched (timeout, I2t) against the operator's clear: SAP 158 and SAP 29 to that
// module, its flags read again, and no setpoint until then.
#include <gtest/gtest.h>

#include <numbers>

#include "drivers/can/twin/can_twin_bus.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot/motor_flags.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/memory/section.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::BusTrouble;
using drivers::can::TmclModule;
namespace flag = drivers::motor_flag;

constexpr std::uint32_t kLatched = flag::kTimeout | flag::kI2tExceeded;
// A module's flags are read once in 64 turns, three of four of which fall into a job.
constexpr int kNamedWithin = 90;

struct LatchRig {
  BusStatus job(bool clear = false) {
    now += 1ms;
    const BusStatus in = bus.sense(now, states);
    detail = bus.detail();
    if (clear) bus.rearm();
    drivers::MotorSetpoints s{drivers::MotorMode::kVelocity, {}};
    s.wheel_rad_per_s.fill(2);
    const BusStatus out = bus.act(now, s);
    return in != BusStatus::kOk ? in : out;
  }
  void jobs(int n, bool clear = false) {
    for (int i = 0; i < n; ++i) (void)job(clear);
  }
  // Jobs until the flags of a wheel are these, of those that are latched.
  int until(std::size_t wheel, std::uint32_t bits, bool clear = false) {
    int n = 0;
    while (n < 1000 && (states.flags[wheel] & kLatched) != bits) {
      EXPECT_EQ(job(clear), BusStatus::kOk) << n;
      ++n;
    }
    return n;
  }
  TmclModule& module(std::size_t i) { return bus.port().modules()[i]; }
  rt::Startup startup;
  drivers::VirtualYoubot robot{
      startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  drivers::can::CanTwinBus bus{startup.token(), robot};
  drivers::MotorStates states;
  drivers::BusDetail detail;
};

TEST(CanLatches, AClearOfTheOperatorClearsEachOnItsModule) {
  for (const std::uint32_t bits : {flag::kTimeout, flag::kI2tExceeded, kLatched}) {
    LatchRig r;
    r.jobs(200);
    r.module(2).timed_out = (bits & flag::kTimeout) != 0;
    r.module(2).tripped = (bits & flag::kI2tExceeded) != 0;
    EXPECT_LE(r.until(2, bits), kNamedWithin);
    r.jobs(300);
    EXPECT_EQ(r.states.flags[2] & kLatched, bits) << "an act, not a time";
    (void)r.job(true);  // one press is enough
    const int until = r.until(2, 0);
    EXPECT_LE(until, 60);
    EXPECT_FALSE(r.module(2).timed_out || r.module(2).tripped);
    r.jobs(20);
    EXPECT_EQ(r.detail, drivers::BusDetail{});
    for (std::size_t m = 0; m < 4; ++m) EXPECT_TRUE(r.module(m).turning) << m;
    EXPECT_EQ(r.bus.bus().counters().refused, 0U);
  }
}

// Until it is done nobody turns: the others would drag the wheel that stands.
TEST(CanLatches, NoSetpointWhileItLasts) {
  LatchRig r;
  r.jobs(200);
  r.module(1).tripped = true;
  (void)r.until(1, flag::kI2tExceeded);
  (void)r.job(true);
  int rearming = 0;
  for (;; ++rearming) {
    ASSERT_EQ(r.job(), BusStatus::kOk);
    if (r.detail.trouble != BusTrouble::kRearming) break;
    ASSERT_LT(rearming, 100);
    r.bus.port().advance(r.now + 1ms);
    for (std::size_t m = 0; m < 4; ++m) ASSERT_FALSE(r.module(m).turning) << m;
  }
  EXPECT_GT(rearming, 5);
  EXPECT_EQ(r.states.flags[1] & kLatched, 0U);
}

// A winding that is hot keeps its flag, however long the clear is held; the bus stays up and what
// the wheels do is read on.
TEST(CanLatches, AHotWindingKeepsItsFlag) {
  LatchRig r;
  r.jobs(200);
  r.module(3).tripped = r.module(3).hot = true;
  (void)r.until(3, flag::kI2tExceeded);
  for (int i = 0; i < 2000; ++i) {
    ASSERT_EQ(r.job(true), BusStatus::kOk) << i;
    ASSERT_EQ(r.states.flags[3] & kLatched, flag::kI2tExceeded) << i;
    ASSERT_LE(r.now - r.states.taken, 9ms) << "positions are as fresh as ever";
  }
  EXPECT_FALSE(r.module(0).turning);
  r.module(3).hot = false;
  EXPECT_LE(r.until(3, 0, true), 100);
}

// After a bus that was down every module is looked at: what it latched meanwhile is not known.
TEST(CanLatches, WhatWasLatchedInASilenceGoesWithTheSameClear) {
  LatchRig r;
  r.jobs(200);
  r.bus.port().bus_off();
  r.jobs(5);
  for (std::size_t m = 0; m < 4; ++m) r.module(m).timed_out = true;
  r.bus.port().restart();
  r.jobs(20);
  EXPECT_EQ(r.states.flags[0] & kLatched, 0U) << "not read yet";
  (void)r.job(true);
  r.jobs(100);
  for (std::size_t m = 0; m < 4; ++m) {
    EXPECT_FALSE(r.module(m).timed_out) << m;
    EXPECT_TRUE(r.module(m).turning) << m;
    EXPECT_EQ(r.states.flags[m] & kLatched, 0U) << m;
  }
}

// One that has no such parameters refuses: counted, asked once a press, and no fault of the bus.
TEST(CanLatches, AModuleThatKnowsNoClearKeepsItsFlagAndTheBusIsUp) {
  LatchRig r;
  r.jobs(200);
  r.module(0).tripped = true;
  r.module(0).knows_clears = false;
  (void)r.until(0, flag::kI2tExceeded);
  (void)r.job(true);
  r.jobs(100);
  EXPECT_EQ(r.bus.bus().counters().refused, 1U);
  EXPECT_EQ(r.states.flags[0] & kLatched, flag::kI2tExceeded);
  EXPECT_EQ(r.detail, drivers::BusDetail{});
  EXPECT_TRUE(r.module(1).turning);
}

// Lost replies: asked again, and nothing else is taken for the answer.
TEST(CanLatches, LostRepliesOnlyDelayIt) {
  LatchRig r;
  r.jobs(200);
  r.module(2).timed_out = true;
  (void)r.until(2, flag::kTimeout);
  (void)r.job(true);
  for (int i = 0; i < 600; ++i) {
    if (i % 60 == 5) r.bus.port().faults().lose_replies = 4;
    (void)r.job();
  }
  r.jobs(100);
  EXPECT_FALSE(r.module(2).timed_out);
  EXPECT_EQ(r.states.flags[2] & kLatched, 0U);
  EXPECT_TRUE(r.module(2).turning);
}

TEST(CanLatches, AllocatesNothing) {
  LatchRig r;
  r.jobs(200);
  r.module(2).timed_out = r.module(1).tripped = true;
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 300; ++i) (void)r.job(i > 120 && i < 200);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  EXPECT_FALSE(r.module(2).timed_out || r.module(1).tripped);
}

}  // namespace
