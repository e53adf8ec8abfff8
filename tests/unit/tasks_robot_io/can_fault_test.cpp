// Every fault of a CAN bus through robot_io: seen within its bound, named with its module, the
// wheels off, and motion only after an act, from what the wheels do.
#include <numbers>

#include "drivers/youbot/motor_flags.hpp"
#include "rt/random.hpp"
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

const std::vector<Fault>& can_stops() {
  static const std::vector<Fault> all{
      {"bus-off", [](Base& b) { b.can->port().bus_off(); },
       [](Base& b) { b.can->port().restart(); }, fault::kBusOff, 1},
      {"bus-off and back at once",
       [](Base& b) {
         b.can->port().bus_off();
         b.can->port().restart();
       },
       [](Base&) {}, fault::kBusOff, 1},
      // It was heard up to 8 jobs ago.
      {"module 3 silent", [](Base& b) { b.can->port().modules()[2].silent = true; },
       [](Base& b) { b.can->port().modules()[2].silent = false; }, fault::kModuleSilent, 100, 3},
      // The queue of 10 fills first, and a module that owes a reply is asked again after 5 ms.
      {"nobody acknowledges", [](Base& b) { b.can->port().faults().cable_cut = true; },
       [](Base& b) { b.can->port().faults().cable_cut = false; }, fault::kQueueFull, 40},
      {"interface down", [](Base& b) { b.can->port().faults().interface_down = true; },
       [](Base& b) { b.can->port().faults().interface_down = false; }, fault::kInterfaceDown, 1},
      // Its next setpoint goes out within four jobs, the answer is read in the job after.
      {"module 2 refuses", [](Base& b) { b.can->port().modules()[1].status_instead = 4; },
       [](Base& b) { b.can->port().modules()[1].status_instead = 0; }, fault::kModuleRefuses, 5, 2},
      // Latched in the module. Its flags are read once in 86 jobs.
      {"module 3: I2t trip",
       [](Base& b) { b.can->port().modules()[2].tripped = b.can->port().modules()[2].hot = true; },
       [](Base& b) { b.can->port().modules()[2].hot = false; }, fault::kI2tExceeded, 90, 0, 2},
      {"module 4: timeout", [](Base& b) { b.can->port().modules()[3].timed_out = true; },
       [](Base&) {}, fault::kMotorTimeout, 90, 0, 3},
  };
  return all;
}

TEST(RobotIoCanFault, EachIsNamedStopsAndIsRecoveredFromByAnAct) {
  for (const Fault& f : can_stops()) {
    Base b(Wire::kCan);
    named_stopped_recovered(b, f);
    if (HasFatalFailure()) return;
  }
}

// The cause goes, and nothing else: the bus stays down, the name stays, no module turns.
TEST(RobotIoCanFault, ThatTheCauseIsGoneIsNoAct) {
  for (const Fault& f : can_stops()) {
    Base b(Wire::kCan);
    b.drive({6, 0, 0}, 1500);
    f.begin(b);
    for (int i = 0; i < 120; ++i) b.job();
    f.end(b);
    b.mode.mode = Mode::kSafeStop;
    for (int i = 0; i < 300; ++i) b.job();
    EXPECT_TRUE(named(b, f)) << f.name << ", fault " << b.health.fault;
    EXPECT_EQ(b.health.severity, Severity::kSafeStop) << f.name;
    for (const auto& m : b.can->port().modules()) EXPECT_FALSE(m.turning) << f.name;
  }
}

// While it lasts a clear that is held names it on, and brings nothing back.
TEST(RobotIoCanFault, AClearBeforeTheCauseIsGoneChangesNothing) {
  for (const Fault& f : can_stops()) {
    // Gone before anybody could clear.
    if (f.name == can_stops()[1].name || f.id == fault::kMotorTimeout) continue;
    Base b(Wire::kCan);
    b.drive({6, 0, 0}, 1500);
    f.begin(b);
    for (int i = 0; i < 120; ++i) b.job();
    b.mode.mode = Mode::kSafeStop;
    b.mode.clear = true;
    for (int i = 0; i < 1000; ++i) {
      b.job();
      ASSERT_TRUE(named(b, f)) << f.name << ", job " << i << ", fault " << b.health.fault;
      ASSERT_EQ(b.health.severity, Severity::kSafeStop) << f.name;
      ASSERT_EQ(b.out.setpoints.mode, MotorMode::kStop) << f.name;
    }
  }
}

// As soon as the box may engage again, at random moments of a roll-out: what the first setpoints go
// out from is of after the fault. A speed is at most 16 jobs old.
TEST(RobotIoCanFault, TheFirstSetpointIsOfWhatTheWheelsDoNow) {
  constexpr std::uint64_t kSeed = 23;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  Base b(Wire::kCan);
  double worst = 0;
  for (int n = 0; n < 200; ++n) {
    b.drive({b.out.state.x_m + 3, b.out.state.y_m, b.out.state.yaw_rad},
            static_cast<int>(random.integer(300, 900)));
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << n;
    b.can->port().bus_off();
    for (std::int64_t i = random.integer(1, 30); i > 0; --i) b.job();
    b.can->port().restart();
    b.mode.mode = Mode::kSafeStop;
    b.mode.clear = true;
    for (int i = 0; i < 100 && (i == 0 || b.health.severity == Severity::kSafeStop); ++i) b.job();
    ASSERT_LT(b.health.severity, Severity::kSafeStop) << n << ", fault " << b.health.fault;
    b.mode.clear = false;
    b.mode.mode = Mode::kEngaged;
    auto before = b.robot.plant().state().wheel_rad_per_s;
    b.job();
    // Off until every speed has been read anew.
    for (int i = 0; i < 20 && b.out.setpoints.mode == MotorMode::kStop; ++i) {
      before = b.robot.plant().state().wheel_rad_per_s;
      b.job();
    }
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << n;
    for (std::size_t w = 0; w < 4; ++w)
      worst = std::max(worst, std::abs(b.out.setpoints.wheel_rad_per_s[w] - before[w]));
  }
  std::printf("first setpoint at most %.3f rad/s off the wheel's speed\n", worst);
  EXPECT_LE(worst, 1.0);
}

// Single ones are counted, by the name of a lost frame; the base drives on.
TEST(RobotIoCanFault, LostRepliesAreCounted) {
  Base b(Wire::kCan);
  b.drive({6, 0, 0}, 1000);
  b.can->port().faults().lose_replies = 1;
  int lost = 0;
  for (int i = 0; i < 20; ++i) {
    b.job();
    if (b.health == rt::Health::of(Severity::kCounted, fault::kFrameLost)) ++lost;
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity);
  }
  EXPECT_EQ(lost, 1);
  EXPECT_EQ(b.health.severity, Severity::kOk);
}

// Doubled replies and checksum errors are the controller's and the driver's business: no state is
// wrong, nothing stops. Delayed ones within their limit neither.
TEST(RobotIoCanFault, DoubledDamagedAndLateRepliesWithinTheLimitChangeNothing) {
  Base b(Wire::kCan);
  b.drive({6, 0, 0}, 1000);
  auto& f = b.can->port().faults();
  f.double_replies = 30;
  f.corrupt = 10;
  f.delay_replies = 1500us;
  for (int i = 0; i < 400; ++i) {
    if (i % 100 == 1) b.send({6, 0, 0});
    b.job();
    ASSERT_LT(b.health.severity, Severity::kSafeStop) << i << ", fault " << b.health.fault;
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << i;
  }
  EXPECT_NEAR(b.out.state.x_m, b.truth().x, 0.02);
}

}  // namespace
}  // namespace tests
