// Boards of the first firmware: 16 bytes of inputs, whose flags end at bit 15. Their latched
// timeout and I2t are asked for by mailbox, so they are seen, named and cleared as on later ones.
#include <gtest/gtest.h>

#include "drivers/youbot/virtual_youbot.hpp"
#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/memory/section.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using namespace std::chrono_literals;
using drivers::BusStatus;
using drivers::BusTrouble;
namespace yb = drivers::youbot_bus;
namespace flag = drivers::motor_flag;

constexpr std::uint32_t kLatched = flag::kTimeout | flag::kI2tExceeded;
constexpr std::size_t kWheel2 = 2, kJoint2 = 7;  // slaves, from 0
constexpr int kSeenWithin = 100;

struct NarrowRig {
  explicit NarrowRig(std::size_t input_bytes = 16, bool two_arms = false)
      : bus(make(input_bytes, two_arms)) {}
  std::unique_ptr<yb::EtherCatTwinBus> make(std::size_t input_bytes, bool two_arms) {
    auto chain = yb::EtherCatTwinBus::base_alone();
    chain.kind = two_arms ? yb::ChainKind::kBaseTwoArms : yb::ChainKind::kBaseArm;
    chain.generation = yb::Generation::kOld;
    chain.input_bytes = input_bytes;
    yb::MotorBusConfig motors;
    motors.joints = {6, 7, 8, 9, 10};
    if (two_arms) motors.joints.insert(motors.joints.end(), {12, 13, 14, 15, 16});
    return std::make_unique<yb::EtherCatTwinBus>(startup.token(), robot, chain, motors);
  }
  BusStatus job(double rad_per_s = 2, bool clear = false) {
    now += 1ms;
    const BusStatus in = bus->sense(now, states);
    detail = bus->detail();
    if (clear) bus->rearm();
    drivers::MotorSetpoints s{drivers::MotorMode::kVelocity, {}};
    s.wheel_rad_per_s.fill(rad_per_s);
    const BusStatus out = bus->act(now, s);
    return in != BusStatus::kOk ? in : out;
  }
  void jobs(int n, bool clear = false) {
    for (int i = 0; i < n; ++i) ASSERT_EQ(job(2, clear), BusStatus::kOk) << i;
  }
  // Jobs until a wheel's latched flags are these.
  int until(std::size_t wheel, std::uint32_t bits) {
    int n = 0;
    for (; n < 1000 && (states.flags[wheel] & kLatched) != bits; ++n) (void)job();
    return n;
  }
  [[nodiscard]] yb::DriveBoard& drive(std::size_t slave) { return *bus->chain().drive(slave); }
  rt::Startup startup;
  drivers::VirtualYoubot robot{
      startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  std::unique_ptr<yb::EtherCatTwinBus> bus;
  drivers::MotorStates states;
  drivers::BusDetail detail;
};

TEST(YoubotNarrowInputs, AWheelsLatchesAreSeenAndCleared) {
  for (const bool trip : {false, true}) {
    NarrowRig r;
    r.jobs(100);
    const auto now = r.bus->port().now();
    trip ? r.drive(kWheel2).trip_i2t(now) : r.drive(kWheel2).time_out(now);
    const std::uint32_t bits = trip ? flag::kI2tExceeded : flag::kTimeout;
    const int seen = r.until(1, bits);
    std::printf("%s of a wheel seen after %d jobs\n", trip ? "I2t" : "timeout", seen);
    EXPECT_LE(seen, kSeenWithin);
    for (const std::size_t w : {0U, 2U, 3U}) EXPECT_EQ(r.states.flags[w] & kLatched, 0U);
    r.jobs(300);
    EXPECT_EQ(r.states.flags[1] & kLatched, bits) << "an act, not a time";
    r.jobs(1000);  // the winding cools
    (void)r.job(2, true);
    const int cleared = r.until(1, 0);
    std::printf("cleared after %d jobs\n", cleared);
    EXPECT_LE(cleared, 300);
    int rearming = 0;
    while (r.job() == BusStatus::kOk && r.detail.trouble == BusTrouble::kRearming) ++rearming;
    EXPECT_LT(rearming, 300);
    r.jobs(20);
    EXPECT_EQ(r.detail, drivers::BusDetail{});
    EXPECT_EQ(r.drive(kWheel2).command().mode, yb::ControllerMode::kVelocity);
  }
}

// A winding that is hot keeps it, whatever the clear's status says.
TEST(YoubotNarrowInputs, AHotWindingKeepsItsFlag) {
  NarrowRig r;
  r.jobs(100);
  r.drive(kWheel2).trip_i2t(r.bus->port().now());
  (void)r.until(1, flag::kI2tExceeded);
  for (int i = 0; i < 800; ++i) {
    ASSERT_EQ(r.job(2, true), BusStatus::kOk) << i;
    ASSERT_EQ(r.states.flags[1] & kLatched, flag::kI2tExceeded) << i;
  }
}

// The first arm's joint 2, and of two arms the second's last: 14 drives are asked in turn.
TEST(YoubotNarrowInputs, AJointThatCanNotHoldIsNamed) {
  for (const bool two : {false, true}) {
    for (const bool trip : {false, true}) {
      const std::size_t joint = two ? 16 : kJoint2;
      NarrowRig r(16, two);
      r.jobs(100);
      ASSERT_EQ(r.detail, drivers::BusDetail{});
      const auto now = r.bus->port().now();
      trip ? r.drive(joint).trip_i2t(now) : r.drive(joint).time_out(now);
      int seen = 0;
      for (; seen < 1000 && r.detail.trouble == BusTrouble::kNone; ++seen) (void)r.job();
      EXPECT_LE(seen, kSeenWithin);
      EXPECT_EQ(r.detail.trouble, trip ? BusTrouble::kJointI2t : BusTrouble::kJointTimeout);
      EXPECT_EQ(r.detail.slave, static_cast<int>(joint) + 1);
      r.jobs(1000);
      r.jobs(1, true);
      r.jobs(400);
      EXPECT_EQ(r.detail, drivers::BusDetail{});
      EXPECT_EQ(r.drive(joint).command().mode, yb::ControllerMode::kPosition);
    }
  }
}

// A firmware that knows no such clear must not keep the base from driving for ever: nothing was
// latched there. What is latched stays named.
TEST(YoubotNarrowInputs, ARefusedClearEndsTheClear) {
  for (const bool trip : {false, true}) {
    NarrowRig r;
    r.jobs(100);
    r.drive(kWheel2).knows_i2t_clear(false);
    if (trip) {
      r.drive(kWheel2).trip_i2t(r.bus->port().now());
      (void)r.until(1, flag::kI2tExceeded);
    }
    (void)r.job(2, true);
    int rearming = 0;
    while (r.job() == BusStatus::kOk && r.detail.trouble == BusTrouble::kRearming &&
           rearming < 1000)
      ++rearming;
    std::printf("rearmed after %d jobs\n", rearming);
    EXPECT_LT(rearming, 300);
    EXPECT_EQ(r.states.flags[1] & kLatched, trip ? flag::kI2tExceeded : 0U);
  }
}

// Later boards tell it in their inputs, at once; nobody is asked.
TEST(YoubotNarrowInputs, WiderOnesAreNotAsked) {
  for (const std::size_t bytes : {18U, 20U, 32U}) {
    NarrowRig r(bytes);
    r.jobs(100);
    EXPECT_FALSE(r.bus->master().mailbox().busy()) << bytes;
    r.drive(kWheel2).trip_i2t(r.bus->port().now());
    EXPECT_LE(r.until(1, flag::kI2tExceeded), 1) << bytes;
  }
}

TEST(YoubotNarrowInputs, AllocatesNothing) {
  NarrowRig r;
  r.jobs(100);
  r.drive(kWheel2).time_out(r.bus->port().now());
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 500; ++i) (void)r.job(2, i > 150 && i < 250);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
}  // namespace tests
