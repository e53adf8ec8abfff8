// What must last: a make_safe() that comes after a request, and one call into the SDK that fails
// for good.
#include <gtest/gtest.h>

#include "drivers/haptic/force_gate.hpp"
#include "tests/unit/drivers_omega/twin_rig.hpp"

namespace {

using drivers::ForceGate;
using namespace twin_rig;

TEST(ForceGate, TheLatestWordCounts) {
  ForceGate gate;
  EXPECT_FALSE(gate.safe());
  EXPECT_FALSE(gate.take());
  gate.ask();
  gate.make_safe();
  EXPECT_TRUE(gate.asked());
  EXPECT_FALSE(gate.take()) << "overtaken";
  EXPECT_FALSE(gate.take()) << "and used up";
  EXPECT_TRUE(gate.safe());
  gate.ask();
  EXPECT_TRUE(gate.take());
  EXPECT_FALSE(gate.safe());
  gate.make_safe();
  gate.ask();
  gate.forget();
  EXPECT_FALSE(gate.take());
  EXPECT_TRUE(gate.safe());
}

// A thread that asks and then makes safe, beside an owner who answers: the last word is always
// "safe".
TEST(ForceGate, NoInstantBetweenLookAndAnswer) {
  for (int round = 0; round < 300; ++round) {
    ForceGate gate;
    std::atomic<bool> done{false};
    std::thread other([&] {
      for (int i = 0; i < 100; ++i) {
        gate.ask();
        gate.make_safe();
      }
      done = true;
    });
    while (!done) (void)gate.take();
    other.join();
    (void)gate.take();
    ASSERT_TRUE(gate.safe()) << "round " << round;
  }
}

TEST(OmegaTwin, MakeSafeOvertakesARequestNotYetSeen) {
  rt::Startup startup;
  drivers::OmegaTwin twin(startup.token(), {}, nullptr);
  rt::Time now = rt::time_from_ns(0);
  const auto tick = [&] {
    now += std::chrono::milliseconds{1};
    drivers::StylusSample s;
    EXPECT_TRUE(twin.sense(now, s));
    twin.act(now, {Vec3(1, 0, 0)});
    return s.state;
  };
  twin.request_enable();
  ASSERT_EQ(tick(), DeviceState::kForce);
  twin.request_enable();
  twin.make_safe();
  EXPECT_EQ(tick(), DeviceState::kBrake);
  EXPECT_EQ(tick(), DeviceState::kBrake);
  EXPECT_EQ(twin.motor_force(), Vec3::Zero());
  twin.request_enable();
  EXPECT_EQ(tick(), DeviceState::kForce);
}

TEST(OmegaDevice, MakeSafeOvertakesARequestNotYetSeen) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  // The owner stalls here: asked, made safe, and only then it looks.
  rig.device->request_enable();
  rig.device->make_safe();
  for (int i = 0; i < 5000 && rig.device->counters().stops == 0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds{1});
  rig.ticks(3, {1, 0, 0});
  EXPECT_EQ(rig.twin.motor(), Vec3::Zero());
  rig.ticks(12, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.state(), DeviceState::kBrake);
  rig.enable();
}

// The positions go on coming; the loss is one all the same.
TEST(OmegaDevice, AStatusThatAlwaysFailsIsALoss) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  rig.twin.set("fail_status", 1);
  rig.ticks(20, {1, 0, 0});
  EXPECT_EQ(rig.device->counters().losses, 0U) << "two of them are none";
  rig.ticks(10, {1, 0, 0});
  EXPECT_EQ(rig.device->counters().losses, 1U);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kDisconnect);
  rig.twin.set("fail_status", 0);
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  rig.ticks(12, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake) << "forces wait for an act";
}

TEST(OmegaDevice, ForcesThatAreNeverTakenAreALoss) {
  Rig rig;
  rig.enable();
  rig.twin.set("fail_forces", 1);
  rig.ticks(2, {1, 0, 0});
  EXPECT_EQ(rig.device->counters().losses, 0U);
  rig.tick({1, 0, 0});
  EXPECT_EQ(rig.device->counters().losses, 1U);
}

}  // namespace
