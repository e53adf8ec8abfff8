// Every fault of the motor bus through robot_io: seen within its bound, named, the wheels off, and
// motion only after an act, from what the wheels do.
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

const std::vector<Fault>& stops() {
  static const std::vector<Fault> all{
      {"a wheel's slave left OP",
       [](Base& b) { b.wire->chain().wire().slave(3).fall(0x0050, b.wire->port().now()); },
       [](Base&) {}, fault::kSlaveState, 12, 4},
      {"a slave too many",
       [](Base& b) {
         static rt::Startup startup;
         b.wire->chain().wire().add(std::make_unique<drivers::ethercat::Esc>(
             startup.token(), drivers::ethercat::EscConfig{},
             b.wire->chain().wire().slave(0).eeprom(),
             std::make_unique<drivers::ethercat::EscApplication>()));
       },
       [](Base& b) { b.wire->chain().wire().cut_behind(5); }, fault::kSlaveState, 2, 6},
      {"cable cut behind slave 2", [](Base& b) { b.wire->chain().wire().cut_behind(2); },
       [](Base& b) { b.wire->chain().wire().cut_behind(5); }, fault::kSlavesMissing, 2, 3},
      {"no link", [](Base& b) { b.wire->port().faults().link_down = true; },
       [](Base& b) { b.wire->port().faults().link_down = false; }, fault::kBusLinkDown, 2},
      {"stuck encoder", [](Base& b) { b.wire->chain().drive(2)->stick_encoder(true); },
       [](Base& b) { b.wire->chain().drive(2)->stick_encoder(false); }, fault::kEncoderStands, 102,
       0, 1, false},
      {"I2t trip", [](Base& b) { b.wire->chain().drive(3)->trip_i2t(b.wire->port().now()); },
       [](Base&) {}, fault::kI2tExceeded, 2, 0, 2},
  };
  return all;
}

TEST(RobotIoBusFault, EachIsNamedStopsAndIsRecoveredFromByAnAct) {
  for (const Fault& f : stops()) {
    Base b(true);
    named_stopped_recovered(b, f);
    if (HasFatalFailure()) return;
  }
}

// The executor's own: too many misses, or a job that hung. No state of the bus tells it.
TEST(RobotIoMadeSafe, IsToldAndEndsByAnAct) {
  const Fault made_safe{"made safe", [](Base& b) { b.bus->make_safe(); }, [](Base&) {},
                        fault::kMadeSafe, 2};
  for (const Wire wire : {Wire::kNone, Wire::kChain, Wire::kCan}) {
    Base b(wire);
    named_stopped_recovered(b, made_safe);
    if (HasFatalFailure()) return;
  }
}

// Its encoders are read on: the robot's state follows the base until it stands, and after that.
TEST(RobotIoBusFault, TheStateFollowsABaseThatRollsOut) {
  Base b(true);
  b.drive({6, 0, 0}, 1500);
  ASSERT_GT(b.out.state.vx, 0.4);
  b.wire->chain().wire().slave(3).fall(0x0050, b.wire->port().now());
  for (int i = 0; i < 500; ++i) b.job();
  EXPECT_EQ(b.health.fault, fault::kSlaveState);
  EXPECT_LT(std::abs(b.out.state.vx), 1e-3);
  EXPECT_EQ(b.out.state.moving, 0);
  EXPECT_NEAR(b.out.state.x_m, b.truth().x, 1e-3);
}

// Counted, named, and nothing else: the base drives on.
TEST(RobotIoBusFault, AWrongCounterIsNamedInItsCycle) {
  Base b(true);
  b.drive({6, 0, 0}, 1000);
  b.wire->port().faults().wrong_counter = 1;
  b.job();
  EXPECT_EQ(b.health, rt::Health::of(Severity::kCounted, fault::kWorkingCounter));
  b.job();
  EXPECT_EQ(b.health.severity, Severity::kOk);
  EXPECT_EQ(b.out.setpoints.mode, MotorMode::kVelocity);
}

// A hundred of them in a row are a bus that is down.
TEST(RobotIoBusFault, ManyBadCyclesInARowStop) {
  for (const bool lost : {true, false}) {
    Base b(true);
    b.drive({6, 0, 0}, 1000);
    auto& faults = b.wire->port().faults();
    (lost ? faults.lose_back : faults.wrong_counter) = 400;
    int jobs = 0;
    for (; jobs < 150 && b.health.severity != Severity::kSafeStop; ++jobs) b.job();
    EXPECT_EQ(jobs, b.config.frames_lost_limit);
    EXPECT_EQ(b.health.fault, fault::kBusDown);
  }
}

// Behind a cut no frame stops the wheels: their own watchdog does, 100 ms after the last one. What
// they roll is that way and the tail of the speed loop, whose PI makes up for its own lag.
TEST(RobotIoBusFault, WheelsBehindACutStopByTheirOwnWatchdog) {
  Base b(true);
  b.drive({6, 0, 0}, 1500);
  const double from = b.truth().x, speed = b.robot.plant().state().v_B.vx;
  ASSERT_GT(speed, 0.45);
  b.wire->chain().wire().cut_behind(1);
  for (int i = 0; i < 500; ++i) b.job();
  const double rolled = b.truth().x - from;
  std::printf("cut at %.2f m/s: rolled %.1f mm\n", speed, 1e3 * rolled);
  EXPECT_LE(rolled, speed * 0.102 + 0.015);
  EXPECT_GE(rolled, speed * 0.090);
  EXPECT_LT(std::abs(b.robot.plant().state().v_B.vx), 1e-3);
}

// Its wheels turn on at a wall: no encoder stands.
TEST(RobotIoBusFault, ACollisionIsNoStuckEncoder) {
  for (const bool chain : {false, true}) {
    Base b(chain, {}, [](const Pose2& X, rt::Time) { return X.x > 0.5; });
    for (int i = 0; i < 4000; ++i) {
      if (i % 100 == 1) b.send({3, 0, 0});
      b.job();
      ASSERT_LT(b.health.severity, Severity::kSafeStop) << i << ", fault " << b.health.fault;
    }
    EXPECT_GT(b.robot.plant().state().collisions, 0U);
  }
}

}  // namespace
}  // namespace tests
