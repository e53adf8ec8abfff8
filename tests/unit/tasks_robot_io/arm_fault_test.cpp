// The arm's drives through robot_io, on a chain of base and arm: a joint that is not held is named,
// the base stands, the others hold.
#include "drivers/youbot/motor_flags.hpp"
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

using drivers::BusTrouble;
using drivers::youbot_bus::ControllerMode;
using drivers::youbot_bus::DriveBoard;

constexpr std::size_t kFirstJoint = 6, kJoint2 = 7;  // from 0 at the master: slave 8

DriveBoard& joint2(Base& b) { return *b.wire->chain().drive(kJoint2); }

const std::vector<std::pair<Fault, BusTrouble>>& arm_stops() {
  static const std::vector<std::pair<Fault, BusTrouble>> all{
      {{"joint 2: I2t trip", [](Base& b) { joint2(b).trip_i2t(b.twin_now()); }, [](Base&) {},
        fault::kJointUnable, 1, 8},
       BusTrouble::kJointI2t},
      {{"joint 2: timeout", [](Base& b) { joint2(b).time_out(b.twin_now()); }, [](Base&) {},
        fault::kJointUnable, 1, 8},
       BusTrouble::kJointTimeout},
      {{"joint 2: lost commutation", [](Base& b) { joint2(b).set_commutated(false, b.twin_now()); },
        [](Base& b) { joint2(b).set_commutated(true, b.twin_now()); }, fault::kJointUnable, 1, 8},
       BusTrouble::kJointNotCommutated},
      {{"joint 2: over-temperature", [](Base& b) { joint2(b).set_faults(1U << 3U, b.twin_now()); },
        [](Base& b) { joint2(b).set_faults(0, b.twin_now()); }, fault::kJointUnable, 1, 8},
       BusTrouble::kJointFault},
  };
  return all;
}

// All but joint 2, and that one too where it can.
void expect_held(Base& b, bool joint2_too) {
  for (std::size_t i = kFirstJoint; i < kFirstJoint + 5; ++i) {
    if (i == kJoint2 && !joint2_too) continue;
    EXPECT_EQ(b.wire->chain().drive(i)->command().mode, ControllerMode::kPosition) << i;
  }
}

TEST(RobotIoArmFault, EachIsNamedStopsAndIsRecoveredFromByAnAct) {
  for (const auto& [f, why] : arm_stops()) {
    Base b(Wire::kChainAndArm);
    named_stopped_recovered(b, f);
    if (HasFatalFailure()) return;
    EXPECT_EQ(b.health.severity, Severity::kOk) << f.name;
    expect_held(b, true);
  }
}

// Without an act it stays so, by the same name and cause; the joint is told to stop, others hold.
TEST(RobotIoArmFault, TheOtherJointsHoldAndTheCauseIsTold) {
  for (const auto& [f, why] : arm_stops()) {
    Base b(Wire::kChainAndArm);
    b.drive({6, 0, 0}, 1000);
    expect_held(b, true);
    f.begin(b);
    b.drive({6, 0, 0}, 2000);
    EXPECT_EQ(b.health, rt::Health::of(Severity::kSafeStop, fault::kJointUnable)) << f.name;
    EXPECT_EQ(b.out.bus.detail.trouble, why) << f.name;
    EXPECT_LT(std::abs(b.robot.plant().state().v_B.vx), 1e-3) << f.name;
    EXPECT_EQ(joint2(b).command().mode, ControllerMode::kStop) << f.name;
    expect_held(b, false);
  }
}

// The winding is hot and the commutation is gone: a clear, however long, does not say otherwise.
TEST(RobotIoArmFault, AClearIsNoCure) {
  for (const bool hot : {true, false}) {
    Base b(Wire::kChainAndArm);
    b.drive({6, 0, 0}, 500);
    if (hot)
      joint2(b).trip_i2t(b.twin_now());
    else
      joint2(b).set_commutated(false, b.twin_now());
    b.job();
    b.mode.mode = Mode::kSafeStop;
    b.mode.clear = true;
    // The winding's time is 1 s.
    for (int i = 0; i < 900; ++i) {
      b.job();
      ASSERT_EQ(b.health, rt::Health::of(Severity::kSafeStop, fault::kJointUnable)) << i;
      ASSERT_EQ(b.out.setpoints.mode, MotorMode::kStop) << i;
    }
  }
}

// A wheel's fault beside it does not hide it, nor does it hide that one once it is gone.
TEST(RobotIoArmFault, BesideAFaultOfAWheel) {
  Base b(Wire::kChainAndArm);
  b.drive({6, 0, 0}, 500);
  joint2(b).set_faults(1U, b.twin_now());
  b.wire->chain().drive(1)->set_faults(1U, b.twin_now());
  b.job();
  EXPECT_EQ(b.health.fault, fault::kJointUnable);
  EXPECT_EQ(b.out.bus.fault, fault::kJointUnable);
  b.mode.mode = Mode::kSafeStop;
  joint2(b).set_faults(0, b.twin_now());
  b.job();
  EXPECT_EQ(b.health.fault, fault::kMotorFault);
  EXPECT_EQ(b.out.bus.fault, fault::kMotorFault);
  EXPECT_EQ(b.out.bus.wheel, 0);
}

// ---- the second arm of two: slave 12 is its board, 13 to 17 are its joints

const std::vector<Fault>& second_arm_stops() {
  static const std::vector<Fault> all{
      {"arm 2 joint 3: left OP",
       [](Base& b) { b.wire->chain().wire().slave(14).fall(0x0050, b.twin_now()); }, [](Base&) {},
       fault::kSlaveState, 18, 15},
      {"arm 2 joint 3: I2t trip",
       [](Base& b) { b.wire->chain().drive(14)->trip_i2t(b.twin_now()); }, [](Base&) {},
       fault::kJointUnable, 1, 15},
      {"cable cut between the arms", [](Base& b) { b.wire->chain().wire().cut_behind(11); },
       [](Base& b) { b.wire->chain().wire().cut_behind(17); }, fault::kSlavesMissing, 2, 12},
  };
  return all;
}

TEST(RobotIoArmFault, OfTheSecondArmEachIsNamedStopsAndIsRecoveredFromByAnAct) {
  for (const Fault& f : second_arm_stops()) {
    Base b(Wire::kChainAndTwoArms);
    named_stopped_recovered(b, f);
    if (HasFatalFailure()) return;
    EXPECT_EQ(b.health.severity, Severity::kOk) << f.name;
    for (const std::size_t first : {6U, 12U})
      for (std::size_t i = first; i < first + 5; ++i)
        EXPECT_EQ(b.wire->chain().drive(i)->command().mode, ControllerMode::kPosition) << i;
  }
}

// A trip of the second arm's joint lets go of nothing else: both arms hold, the base stands.
TEST(RobotIoArmFault, BesideATrippedJointOfTheSecondArmTheFirstHolds) {
  Base b(Wire::kChainAndTwoArms);
  b.drive({6, 0, 0}, 1000);
  b.wire->chain().drive(14)->trip_i2t(b.twin_now());
  b.drive({6, 0, 0}, 500);
  EXPECT_EQ(b.health, rt::Health::of(Severity::kSafeStop, fault::kJointUnable));
  EXPECT_EQ(b.out.bus.detail.trouble, BusTrouble::kJointI2t);
  EXPECT_EQ(b.out.bus.detail.slave, 15);
  for (const std::size_t first : {6U, 12U})
    for (std::size_t i = first; i < first + 5; ++i)
      EXPECT_EQ(b.wire->chain().drive(i)->command().mode,
                i == 14 ? ControllerMode::kStop : ControllerMode::kPosition)
          << i;
}

}  // namespace
}  // namespace tests
