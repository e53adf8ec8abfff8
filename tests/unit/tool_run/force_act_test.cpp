// Forces come back with an act of a person, never by the passing of time; a simulated person acts
// by time.
#include "tools/touch/force_act.hpp"

#include <gtest/gtest.h>

namespace {

using drivers::DeviceState;
using teletact::ForceAct;

// A console's tick every 20 ms, a device's every one; how often forces were asked for.
struct Desk {
  ForceAct act;
  std::int64_t ms = 1000;
  int asked = 0;
  explicit Desk(bool simulated) : act(simulated) {}
  void pass(int n, DeviceState state, bool clutch = false) {
    for (int i = 0; i < n; ++i) {
      act.see(state, clutch);
      if (++ms % 20 == 0) asked += act.due(rt::time_from_ns(ms * 1'000'000)) ? 1 : 0;
    }
  }
};

TEST(ForceAct, OfARealDeviceNeverByTimeWhateverBraked) {
  Desk desk(false);
  desk.pass(100, DeviceState::kForce);
  EXPECT_FALSE(desk.act.waits());
  for (const auto off : {DeviceState::kBrake, DeviceState::kIdle, DeviceState::kReset}) {
    desk.pass(10'000, off);
    EXPECT_EQ(desk.asked, 0);
    EXPECT_EQ(desk.act.waits(), off != DeviceState::kReset);
    desk.pass(100, DeviceState::kForce);
  }
}

TEST(ForceAct, OfARealDeviceIsTheClutchPressedAndLetGo) {
  Desk desk(false);
  desk.pass(100, DeviceState::kForce, true);  // held as it brakes: no act, nor is letting go of it
  desk.pass(100, DeviceState::kBrake, true);
  desk.pass(500, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 0);
  desk.pass(100, DeviceState::kBrake, true);
  EXPECT_EQ(desk.asked, 0) << "not before it is let go";
  desk.pass(500, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 1) << "once";
  desk.pass(3, DeviceState::kBrake, true);  // shorter than a tick of the console
  desk.pass(40, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 2);
  // One while forces flow moves the workspace, and does not wait for the next brake.
  desk.pass(100, DeviceState::kForce);
  desk.pass(100, DeviceState::kForce, true);
  desk.pass(100, DeviceState::kForce);
  desk.pass(500, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 2);
}

TEST(ForceAct, OfATwinIsThePersonWhoNotices) {
  Desk desk(true);
  desk.pass(280, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 0);
  desk.pass(60, DeviceState::kBrake);
  EXPECT_EQ(desk.asked, 1);
  EXPECT_FALSE(desk.act.waits());
  desk.pass(1000, DeviceState::kForce);
  EXPECT_EQ(desk.asked, 1);
}

}  // namespace
