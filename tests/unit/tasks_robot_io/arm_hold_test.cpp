// The arm has no brakes: whatever stops the wheels, and while the operator's clear is held, every
// frame tells each joint that can hold to hold the position that it has held before.
#include "drivers/youbot/motor_flags.hpp"
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

using drivers::youbot_bus::ControllerMode;
using drivers::youbot_bus::DriveOutputs;

constexpr std::size_t kWheel2 = 2;

struct Arms {
  explicit Arms(Wire way)
      : base(way),
        joints(way == Wire::kChainAndTwoArms
                   ? std::vector<std::size_t>{6, 7, 8, 9, 10, 12, 13, 14, 15, 16}
                   : std::vector<std::size_t>{6, 7, 8, 9, 10}) {
    base.drive({6, 0, 0}, 500);
    for (const std::size_t j : joints) held.push_back(told(j).value);
  }
  [[nodiscard]] DriveOutputs told(std::size_t slave) {
    DriveOutputs o;
    EXPECT_TRUE(decode(base.wire->master().outputs(slave), o));
    return o;
  }
  // How many of these jobs let a joint go, on the wire or at its board.
  int let_go(int jobs) {
    int bad = 0;
    for (int i = 0; i < jobs; ++i) {
      base.job();
      bool all = true;
      for (std::size_t k = 0; k < joints.size(); ++k) {
        if (joints[k] == spared) continue;
        all = all && told(joints[k]) == DriveOutputs{held[k], ControllerMode::kPosition} &&
              base.wire->chain().drive(joints[k])->command().mode == ControllerMode::kPosition;
      }
      bad += all ? 0 : 1;
    }
    return bad;
  }
  // Stopped, and then a clear that is pressed for so long.
  void expect_held(const char* what, int stopped, int cleared) {
    EXPECT_EQ(let_go(stopped), 0) << what << ", stopped";
    base.mode.mode = Mode::kSafeStop;
    EXPECT_EQ(let_go(20), 0) << what << ", seen";
    base.mode.clear = true;
    EXPECT_EQ(let_go(cleared), 0) << what << ", while the clear is held";
    base.mode.clear = false;
    EXPECT_EQ(let_go(100), 0) << what << ", after it";
  }
  Base base;
  std::vector<std::size_t> joints;
  std::vector<std::int32_t> held;
  std::size_t spared = 0;  // may let go
};

constexpr std::array kWires{Wire::kChainAndArm, Wire::kChainAndTwoArms};

TEST(RobotIoArmHold, AnOrdinaryStopAndItsClear) {
  for (const Wire way : kWires) {
    Arms a(way);
    a.expect_held("stop", 1, 500);
  }
}

// Each drive at fault lets go of none but itself, however long the clear is pressed.
TEST(RobotIoArmHold, ADriveAtFaultAndAClearHeldForLong) {
  for (const Wire way : kWires) {
    for (const std::size_t slave : {kWheel2, std::size_t{7}}) {
      for (const int what : {0, 1, 2}) {
        Arms a(way);
        a.spared = slave;
        auto& drive = *a.base.wire->chain().drive(slave);
        if (what == 0) drive.trip_i2t(a.base.twin_now());
        if (what == 1) drive.time_out(a.base.twin_now());
        if (what == 2) drive.set_faults(1U << 3U, a.base.twin_now());
        a.expect_held(what == 0 ? "I2t" : what == 1 ? "timeout" : "over-temperature", 300, 2000);
      }
    }
  }
}

// A slave of a wheel, or of a joint, leaves OP: after 100 short cycles the master stops. The arm's
// others hold then, and while the slave is brought back.
TEST(RobotIoArmHold, ASlaveThatFellAndIsBroughtBack) {
  for (const Wire way : kWires) {
    for (const std::size_t slave : {kWheel2, std::size_t{7}}) {
      Arms a(way);
      a.spared = slave;
      a.base.wire->chain().wire().slave(slave).fall(0x0050, a.base.twin_now());
      a.expect_held("left OP", 1000, 500);
      EXPECT_EQ(a.base.health.severity, Severity::kOk);
      if (slave == kWheel2) continue;
      EXPECT_EQ(a.told(slave).mode, ControllerMode::kPosition) << "held again";
    }
  }
}

// A joint that sank while its slave was out of OP is held where it is, not drawn back.
TEST(RobotIoArmHold, AJointThatWasMovedWhileItsSlaveWasOutOfOpIsNotDrawnBack) {
  constexpr std::size_t kJoint = 7;
  Arms a(Wire::kChainAndArm);
  a.spared = kJoint;
  auto& drive = *a.base.wire->chain().drive(kJoint);
  a.base.wire->chain().wire().slave(kJoint).fall(0x0050, a.base.twin_now());
  for (int i = 0; i < 50; ++i) a.base.job();
  const auto from = drive.motor().motion(a.base.twin_now()).position_ticks;
  drive.motor().command({ControllerMode::kVelocity, 300}, a.base.twin_now());
  for (int i = 0; i < 200; ++i) a.base.job();
  drive.motor().command({}, a.base.twin_now());
  const auto moved = drive.motor().motion(a.base.twin_now()).position_ticks;
  ASSERT_GT(std::abs(moved - from), 1000);
  a.base.mode.mode = Mode::kSafeStop;
  a.base.mode.clear = true;
  for (int i = 0; i < 500; ++i) a.base.job();
  ASSERT_EQ(a.told(kJoint).mode, ControllerMode::kPosition);
  EXPECT_NEAR(drive.motor().motion(a.base.twin_now()).position_ticks, moved, 50);
}

// Frames that are lost for less than the boards' 100 ms let nothing go.
TEST(RobotIoArmHold, AGapOfFramesAndAClear) {
  for (const Wire way : kWires) {
    Arms a(way);
    a.base.wire->port().faults().lose_out = 2 * 80;
    a.expect_held("gap", 200, 500);
  }
}

}  // namespace
}  // namespace tests
