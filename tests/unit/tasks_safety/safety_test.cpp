// The safety lines through the robot's box: from an edge to the wire, what each fault does, how it
// clears, and how motion begins again after a stop.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/quantile.hpp"
#include "rt/random.hpp"
#include "tasks/robot_io/safety_watch.hpp"
#include "tests/unit/tasks_safety/robot_rig.hpp"

namespace tests {
namespace {

namespace fault = tasks::robot_io_fault;
using drivers::MotorMode;
using tasks::Mode;

bool zero(const drivers::MotorSetpoints& s) {
  return s.mode == MotorMode::kStop &&
         std::all_of(s.wheel_rad_per_s.begin(), s.wheel_rad_per_s.end(),
                     [](double w) { return w == 0; });
}

TEST(Safety, DrivesWithHealthyLinesAndShowsIt) {
  RobotRig r;
  r.jobs(100);
  EXPECT_EQ(r.mode(), Mode::kHold);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  r.jobs(600);
  EXPECT_GT(r.speed(), 0.4);
  EXPECT_TRUE(r.twin.output(1)) << "the lamp is on";
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
}

// 1,000 presses at random moments of a drive. Jobs begin up to 0.25 ms after their release: a job
// that reads the lines right before the press leaves the whole period, and the next one's delay.
TEST(Safety, EdgeToWireWithinAPeriod) {
  RobotRig r;
  r.jobs(100);
  rt::Random random(22);
  double worst_us = 0;
  std::vector<double> waits;
  for (int press = 0; press < 1000; ++press) {
    r.twin.release(r.now);
    r.jobs(30);
    r.drive_on();
    const auto drive = random.integer(20, 200);
    for (int i = 0; i < drive; ++i) r.job(rt::Nanos{random.integer(0, 250'000)});
    ASSERT_EQ(r.mode(), Mode::kEngaged) << press;
    const rt::Time edge = r.now + rt::Nanos{random.integer(1, 1'000'000)};
    r.twin.press(edge);
    do r.job(rt::Nanos{random.integer(0, 250'000)});
    while (r.now < edge);
    ASSERT_TRUE(zero(r.bus.sent)) << press;
    ASSERT_EQ(r.health.fault, fault::kEstopOpen);
    const double us = 1e6 * rt::seconds(r.bus.sent_at - edge);
    waits.push_back(us);
    worst_us = std::max(worst_us, us);
    for (int i = 0; i < 20; ++i) {
      r.job();
      ASSERT_TRUE(zero(r.bus.sent)) << press << " " << i;
    }
    ASSERT_EQ(r.mode(), Mode::kSafeStop) << press;
  }
  std::printf("estop.to_wire_p99_us %.0f, worst %.0f\n", rt::quantile(waits, 0.99), worst_us);
  EXPECT_LE(worst_us, 1300);
  EXPECT_GT(worst_us, 900) << "the presses do not reach the worst moment";
}

// The same on EtherCAT: the bytes that the slaves take.
TEST(Safety, TheFrameOfThatJobCarriesMotorStop) {
  RobotRig r;
  drivers::youbot_bus::EtherCatTwinBus wire(r.startup.token(), r.robot);
  WatchedBus bus(wire);
  r.setup.bus = &bus;
  r.robot_io =
      std::make_unique<tasks::RobotIoNode>(r.startup.token(), r.config, r.setup, r.cells, r.link);
  r.jobs(100);
  for (int press = 0; press < 5; ++press) {
    r.twin.release(r.now);
    r.jobs(30);
    r.drive_on();
    r.jobs(300);
    const auto driving = wire.master().outputs(1);
    ASSERT_TRUE(std::any_of(driving.begin(), driving.end(), [](auto b) { return b != 0; }));
    r.twin.press(r.now + rt::Nanos{1 + 200'000 * press});
    r.job();
    for (const std::size_t slave : {1U, 2U, 3U, 4U})
      for (const auto b : wire.master().outputs(slave)) ASSERT_EQ(b, 0) << press;
    r.jobs(50);
  }
}

// Clear and engage after a stop, at random moments, so that the base may still roll: the first
// setpoint is what the wheels do, nothing drives before the engage, and an old goal drives nothing.
TEST(Safety, TheFirstSetpointAfterAStopIsNoStep) {
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  rt::Random random(1000);
  int rolling = 0;
  for (int stop = 0; stop < 1000; ++stop) {
    for (auto n = random.integer(5, 150); n > 0; --n) r.job();
    ASSERT_EQ(r.mode(), Mode::kEngaged) << stop;
    r.twin.press(r.now + rt::Nanos{random.integer(1, 900'000)});
    r.jobs(static_cast<int>(random.integer(1, 20)));
    r.twin.release(r.now);
    r.twin.let_go(r.now);
    r.jobs(static_cast<int>(random.integer(21, 60)));
    r.twin.hold(r.now);
    r.jobs(22);
    // The operator clears; the first setpoints that are not "off" come somewhere in here.
    r.clear = r.engage = false;
    r.say_now = true;
    r.jobs(12);
    r.clear = r.say_now = true;
    bool first = true;
    for (int i = 0; i < 40; ++i) {
      const auto states = r.bus.before;
      r.job();
      if (r.bus.sent.mode != MotorMode::kVelocity || !first) continue;
      first = false;
      rolling += std::abs(states.wheel_rad_per_s[0]) > 0.01 ? 1 : 0;
      for (std::size_t w = 0; w < 4; ++w)
        ASSERT_EQ(r.bus.sent.wheel_rad_per_s[w], r.bus.before.wheel_rad_per_s[w]) << stop;
    }
    ASSERT_FALSE(first) << stop;
    r.clear = false;
    r.say_now = true;
    r.jobs(12);
    drivers::MotorSetpoints last = r.bus.sent;
    r.engage = r.say_now = true;
    for (int i = 0; i < 25; ++i) {
      r.job();
      for (std::size_t w = 0; w < 4; ++w)
        ASSERT_LE(std::abs(r.bus.sent.wheel_rad_per_s[w] - last.wheel_rad_per_s[w]), 0.1)
            << stop << ": an acceleration of 1 m/s^2 is 0.021 rad/s a job; a ramp down 0.085";
      last = r.bus.sent;
    }
  }
  std::printf("1000 stops, %d of them cleared while the base rolled\n", rolling);
}

TEST(Safety, AGoalFromBeforeTheStopIsVoid) {
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(300);
  r.twin.press(r.now);
  r.jobs(30);
  r.twin.release(r.now);
  r.jobs(30);
  // The mode goes on by itself here, and no new goal comes: the newest one is from the stop.
  auto in = r.robot_io->in();
  rt::Startup startup;
  tasks::RobotIoTask task(startup.token(), {});
  tasks::RobotIoTask::Out out;
  tasks::ModeMsg mode;
  drivers::RobotGoal goal;
  goal.seq = 7;
  goal.made = r.now;
  goal.engaged = 1;
  goal.x_m = 5;
  goal.speed_limit_m_per_s = 0.5;
  goal.valid_until = r.now + 10s;
  in.goal = &goal;
  in.mode = &mode;
  const auto step = [&](Mode m, bool open) {
    mode.mode = m;
    in.safety.estop_open = open;
    in.safety.enable_fitted = false;
    in.link_heard_at = r.now;
    rt::Tick t;
    t.release = t.start = r.now;
    t.period = 1ms;
    (void)task.step(t, in, out);
    r.now += 1ms;
  };
  for (int i = 0; i < 5; ++i) step(Mode::kEngaged, false);
  EXPECT_TRUE(out.telemetry.driving);
  step(Mode::kEngaged, true);
  for (int i = 0; i < 5; ++i) step(Mode::kSafeStop, true);
  for (int i = 0; i < 5; ++i) step(Mode::kEngaged, false);
  EXPECT_FALSE(out.telemetry.driving) << "the goal of before the stop";
  goal.seq = 8;
  goal.made = r.now;
  r.now += 1ms;
  step(Mode::kEngaged, false);
  EXPECT_TRUE(out.telemetry.driving);
}

// ---- each row of the table

TEST(SafetyFaults, EmergencyStop) {  // F-RIO-20
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(200);
  r.twin.press(r.now);
  r.jobs(15);
  EXPECT_EQ(r.health, rt::Health::of(rt::Severity::kSafeStop, fault::kEstopOpen));
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  EXPECT_EQ(r.newest_mode().cause, fault::kEstopOpen);
  r.press_clear();
  EXPECT_EQ(r.mode(), Mode::kSafeStop) << "still pressed";
  r.twin.release(r.now);
  r.jobs(500);
  EXPECT_EQ(r.mode(), Mode::kSafeStop) << "a release starts nothing";
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kSafeStop) << "nor does an engage";
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms)) << "the arm is to hold its place";
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
}

// A press that is over before supervision looks is a stop all the same.
TEST(SafetyFaults, AShortPressStops) {
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(200);
  r.twin.press(r.now + 100us);
  r.twin.release(r.now + 150us);
  r.jobs(60);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
}

TEST(SafetyFaults, LinesThatCanNotBeRead) {  // F-RIO-21
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(200);
  r.twin.unreadable(true);
  r.job();
  EXPECT_EQ(r.health, rt::Health::of(rt::Severity::kSafeStop, fault::kLinesUnread));
  EXPECT_TRUE(zero(r.bus.sent)) << "in the same job";
  r.jobs(15);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms)) << "no heartbeat of a blind job";
  r.twin.unreadable(false);
  r.jobs(50);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
}

TEST(SafetyFaults, ContactsThatDisagree) {  // F-RIO-22
  RobotRig r;
  r.jobs(100);
  r.twin.weld_second(true);
  r.twin.press(r.now);
  r.jobs(80);
  EXPECT_EQ(r.health, rt::Health::of(rt::Severity::kSafeStop, fault::kEstopDisagree));
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  r.twin.release(r.now);
  r.jobs(40);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
}

TEST(SafetyFaults, EnableSwitch) {  // F-RIO-23
  RobotRig r;
  r.jobs(200);
  EXPECT_EQ(r.health, rt::Health::of(rt::Severity::kRampDown, fault::kNotEnabled))
      << "held since the start, as a taped switch is";
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kHold);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  r.jobs(500);
  ASSERT_GT(r.speed(), 0.4);
  r.twin.let_go(r.now);
  r.job();
  r.job();
  EXPECT_LT(r.bus.sent.wheel_rad_per_s[1], r.bus.before.wheel_rad_per_s[1]);
  EXPECT_EQ(r.bus.sent.mode, MotorMode::kVelocity) << "a ramp, no motors off";
  r.jobs(200);
  EXPECT_LT(r.speed(), 0.01);
  r.jobs(200);
  EXPECT_EQ(r.mode(), Mode::kHold);
  r.twin.hold(r.now);
  r.jobs(100);
  EXPECT_EQ(r.mode(), Mode::kHold) << "holding it again is no engage";
  EXPECT_EQ(r.health, rt::Health::ok()) << "it was seen let go";
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  // A stop by another cause: the switch is held all the time.
  r.twin.press(r.now);
  r.jobs(20);
  r.twin.release(r.now);
  r.jobs(40);
  r.press_clear();
  EXPECT_EQ(r.mode(), Mode::kHold);
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kHold) << "it was not let go since the stop";
  r.twin.let_go(r.now);
  r.jobs(30);
  r.twin.hold(r.now);
  r.jobs(30);
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
}

TEST(SafetyFaults, LostEdgesAreCounted) {  // F-RIO-24
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  for (int i = 0; i < 60; ++i) {  // of the enable switch, so that nothing stops before
    r.twin.let_go(r.now + rt::Nanos{1000 * i + 10});
    r.twin.hold(r.now + rt::Nanos{1000 * i + 20});
  }
  r.job();
  const bool told = r.health.fault == fault::kEdgesLost || r.robot_io->in().safety.edges_lost;
  r.job();
  EXPECT_TRUE(told || r.robot_io->in().safety.edges_lost);
}

TEST(SafetyFaults, OutputsThatDoNotTake) {  // F-RIO-25
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(200);
  r.twin.unwritable(true);
  r.jobs(15);
  EXPECT_NE(r.mode(), Mode::kEngaged);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms));
  r.jobs(300);
  EXPECT_EQ(r.mode(), Mode::kHold);
  r.twin.unwritable(false);
  r.jobs(5);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
}

TEST(SafetyFaults, ALostBusEndsTheHeartbeatUntilTheClear) {
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  r.jobs(100);
  r.bus.down = true;
  r.jobs(20);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms));
  r.bus.down = false;
  r.jobs(100);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms)) << "power comes back by an act alone";
  r.press_clear();
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
}

TEST(SafetyFaults, ATaskThatFallsSilentIsAStopThatIsNotSampled) {  // F-SUP-01
  RobotRig r;
  r.jobs(100);
  r.drive_on();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  const auto before = r.robot_io->in().mode->seq;
  r.now += 70ms;
  r.release += 70ms;
  r.link.last_heard_ns = rt::ns_of(r.now);
  r.run(*r.supervision, 10ms);
  EXPECT_EQ(r.last_health.severity, rt::Severity::kSafeStop);
  r.twin.let_go(r.now);
  r.job();
  EXPECT_GT(r.robot_io->in().mode->seq, before);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
}

TEST(SafetyFaults, ARobotWithoutLinesKnowsNoneOfIt) {
  RobotRig r(safety_lines(), false);
  r.jobs(100);
  r.press_engage();
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  r.twin.press(r.now);
  r.jobs(100);
  EXPECT_EQ(r.mode(), Mode::kEngaged);
  EXPECT_EQ(r.twin.beats(), 0U);
}

// What a person reads of a cut: the first slave that is missing, once, and what to do.
TEST(Safety, TheLogNamesTheSlaveOnce) {
  RobotRig r;
  drivers::youbot_bus::EtherCatTwinBus wire(r.startup.token(), r.robot);
  r.setup.bus = &wire;
  r.robot_io =
      std::make_unique<tasks::RobotIoNode>(r.startup.token(), r.config, r.setup, r.cells, r.link);
  r.jobs(100);
  r.drive_on();
  wire.chain().wire().cut_behind(3);
  r.jobs(200);
  EXPECT_EQ(r.health.fault, fault::kSlavesMissing);
  EXPECT_EQ(r.mode(), Mode::kSafeStop);
  std::vector<std::string> lines;
  auto& logs = *r.cells.logs;
  rt::LogRecord record;
  while (logs.of(tasks::TaskId::kRobotIo).try_pop(record)) {
    const std::string line = logs.sites().text(record);
    if (line.find("F-RIO-12") != std::string::npos) lines.push_back(line);
  }
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0],
            "F-RIO-12 from slave 4 on nobody answers; to do: check the cable before that slave, "
            "motor power, the emergency stop, then clear");
}

}  // namespace
}  // namespace tests
