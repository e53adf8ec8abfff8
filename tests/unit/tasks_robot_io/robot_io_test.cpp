#include "tasks/robot_io/robot_io_task.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::RobotGoal;
using drivers::RobotPlant;
using drivers::RobotPlantConfig;
using drivers::VirtualYoubot;
using perception::Pose2;
using tasks::Mode;
using tasks::ModeMsg;
using tasks::RobotIoConfig;
using tasks::RobotIoTask;
namespace fault = tasks::robot_io_fault;

// The robot box without the box: task and virtual robot, 1 kHz, outputs act in the same job.
struct Robot {
  rt::Startup startup;
  RobotIoConfig config;
  VirtualYoubot bus;
  RobotIoTask task;
  RobotIoTask::In in;
  RobotIoTask::Out out;
  ModeMsg mode;
  RobotGoal goal;
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  std::uint64_t k = 0;
  rt::Health health;
  bool link_alive = true;

  explicit Robot(const RobotPlantConfig& plant = {}, const Pose2& start = {},
                 const RobotIoConfig& c = {})
      : config(with_start(c, start)),
        bus(startup.token(), {}, RobotPlant(startup.token(), plant, {}, start)),
        task(startup.token(), config) {
    mode.mode = Mode::kEngaged;
    in.mode = &mode;
  }
  static RobotIoConfig with_start(RobotIoConfig c, const Pose2& p) {
    c.start_x_m = p.x;
    c.start_y_m = p.y;
    c.start_yaw_rad = p.yaw;
    return c;
  }
  void send(const Pose2& p, rt::Nanos valid = 300ms, double speed = 0.5) {
    ++goal.seq;
    goal.made = now;
    goal.valid_until = now + valid;
    goal.x_m = p.x;
    goal.y_m = p.y;
    goal.yaw_rad = p.yaw;
    goal.speed_limit_m_per_s = speed;
    goal.engaged = 1;
    in.goal = &goal;
  }
  void tick() {
    rt::Tick t;
    t.k = k++;
    t.release = t.start = now;
    t.period = 1ms;
    {
      rt::Section section;
      in.bus = bus.sense(now, in.motors);
      if (link_alive) {
        in.link_heard = true;
        in.link_heard_at = now;
      }
      health = task.step(t, in, out);
    }
    if (out.rearm_motors) bus.rearm();
    in.sent = bus.act(now, out.setpoints);
    now += 1ms;
  }
  void run(int ms) {
    for (int i = 0; i < ms; ++i) tick();
  }
  [[nodiscard]] const drivers::PlantState& truth() const { return bus.plant().state(); }
  [[nodiscard]] double error(const Pose2& p) const {
    return std::hypot(truth().X_WB.x - p.x, truth().X_WB.y - p.y);
  }
};

struct Worst {
  double tracking = 0, overshoot = 0, speed = 0, acceleration = 0, yaw_rate = 0;
};

// Drives to `p`, the goal renewed at 10 Hz as prediction does, and watches the limits on what is
// commanded and on what the true base does.
Worst drive(Robot& r, const Pose2& p, int ms) {
  Worst w;
  const Pose2 from = r.truth().X_WB;
  const double d = std::hypot(p.x - from.x, p.y - from.y);
  double last_x = 0, last_y = 0;
  bool first = true;
  for (int i = 0; i < ms; ++i) {
    if (i % 100 == 0) r.send(p);
    r.tick();
    const auto& s = r.out.state;
    const double c = std::cos(s.yaw_rad), n = std::sin(s.yaw_rad);
    const double x = c * s.cmd_vx - n * s.cmd_vy, y = n * s.cmd_vx + c * s.cmd_vy;
    if (!first) {
      w.acceleration = std::max(w.acceleration, std::hypot(x - last_x, y - last_y) / 1e-3);
    }
    first = false;
    last_x = x;
    last_y = y;
    w.speed = std::max(w.speed, std::hypot(x, y));
    w.yaw_rate = std::max(w.yaw_rate, std::abs(s.cmd_wz));
    w.tracking = std::max(w.tracking, r.out.telemetry.tracking_error_m);
    const Pose2& t = r.truth().X_WB;
    if (d > 0) {
      const double along = ((t.x - from.x) * (p.x - from.x) + (t.y - from.y) * (p.y - from.y)) / d;
      w.overshoot = std::max(w.overshoot, along - d);
    }
  }
  return w;
}

RobotPlantConfig hard_plant() {
  RobotPlantConfig c;
  c.encoder_ticks_per_motor_turn = 4000;
  c.dead_time_s = 0.002;
  c.gear_friction_Nm = 0.3;
  return c;
}

TEST(RobotIo, StraightSidewaysTurnAndAll) {
  const Pose2 goals[] = {{1.5, 0, 0}, {0, -1, 0}, {0, 0, 2.5}, {1, 1, -1.5}, {-0.05, 0.02, 0.1}};
  for (const bool hard : {false, true}) {
    for (const Pose2& g : goals) {
      Robot r(hard ? hard_plant() : RobotPlantConfig{}, {0.3, -0.2, 0.4});
      const Pose2 p = perception::compose({0.3, -0.2, 0.4}, g);
      const Worst w = drive(r, p, 7000);
      std::printf("goal (%.2f %.2f %.2f) %s: tracking %.1f mm, overshoot %.2f mm, end %.2f mm\n",
                  g.x, g.y, g.yaw, hard ? "hard" : "plain", 1e3 * w.tracking, 1e3 * w.overshoot,
                  1e3 * r.error(p));
      EXPECT_LE(w.tracking, 0.030);
      EXPECT_LE(w.overshoot, 0.002);
      EXPECT_LE(r.error(p), 0.010);
      EXPECT_LE(std::abs(perception::wrap_angle(r.truth().X_WB.yaw - p.yaw)), 0.02);
      EXPECT_EQ(r.out.state.moving, 0);
    }
  }
}

// Any goals at any instant: what is commanded stays inside the limits.
TEST(RobotIo, LimitsHoldForRandomGoals) {
  const std::uint64_t seed = 51;
  rt::Random random(seed);
  Robot r(hard_plant());
  const auto& limits = r.config.trajectory;
  for (int i = 0; i < 60; ++i) {
    const Pose2 p{random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-3.1, 3.1)};
    const Worst w = drive(r, p, static_cast<int>(random.integer(50, 2500)));
    ASSERT_LE(w.speed, limits.speed_m_per_s + 1e-9) << "seed " << seed << " goal " << i;
    ASSERT_LE(w.yaw_rate, limits.yaw_rate_rad_per_s + 1e-9) << "seed " << seed << " goal " << i;
    // The measured yaw turns by at most 0.8 mrad between two ticks: 0.5 m/s of it shows here.
    ASSERT_LE(w.acceleration, limits.acceleration_m_per_s2 * (1 + 1e-6))
        << "seed " << seed << " goal " << i;
    ASSERT_LE(w.tracking, 0.030) << "seed " << seed << " goal " << i;
  }
}

// A carrot that runs along an arc 0.35 m ahead, as the path follower's does.
TEST(RobotIo, FollowsAnArc) {
  Robot r(hard_plant());
  const double radius = 1.0, speed = 0.4;
  double tracking = 0, off = 0;
  for (int ms = 0; ms < 8000; ++ms) {
    if (ms % 100 == 0) {
      const double a = (speed * ms * 1e-3 + 0.35) / radius;
      r.send({radius * std::sin(a), radius * (1 - std::cos(a)), a > M_PI ? a - 2 * M_PI : a}, 300ms,
             speed);
    }
    r.tick();
    tracking = std::max(tracking, r.out.telemetry.tracking_error_m);
    const Pose2& t = r.truth().X_WB;
    off = std::max(off, std::abs(std::hypot(t.x, t.y - radius) - radius));
  }
  std::printf("arc: tracking %.1f mm, off the circle %.1f mm\n", 1e3 * tracking, 1e3 * off);
  EXPECT_LE(tracking, 0.030);
  // Pursuit of a point l ahead runs tangentially at r - sqrt(r^2 - l^2) inside the circle; the
  // point is up to one goal period further ahead than it was sent.
  const double ahead = 0.35 + speed * 0.1;
  EXPECT_LE(off, radius - std::sqrt(radius * radius - ahead * ahead));
  EXPECT_GE(off, 0.02);
  EXPECT_GT(r.truth().path_m, 2.0);
}

// What stops the robot must do so along the ramp: v / a seconds, v^2 / 2a metres, no jump. Returns
// the time from now until the true base stands for good, ms.
int expect_smooth_stop(Robot& r, const char* what, int after_ms, double a) {
  const double v0 = std::hypot(r.truth().v_B.vx, r.truth().v_B.vy);
  EXPECT_GT(v0, 0.4) << what;
  const Pose2 from = r.truth().X_WB;
  double last = std::hypot(r.out.state.cmd_vx, r.out.state.cmd_vy), steepest = 0;
  int stands_ms = 0;
  for (int i = 0; i < after_ms + 800; ++i) {
    r.tick();
    const double v = std::hypot(r.out.state.cmd_vx, r.out.state.cmd_vy);
    steepest = std::max(steepest, (last - v) / 1e-3);
    last = v;
    if (std::hypot(r.truth().v_B.vx, r.truth().v_B.vy) > 0.01) stands_ms = i + 1;
  }
  EXPECT_LE(steepest, a * (1 + 1e-6)) << what;
  EXPECT_GE(steepest, a * (1 - 1e-6)) << what << ": slower than it may";
  EXPECT_EQ(last, 0) << what;
  EXPECT_NEAR(r.truth().v_B.vx, 0, 1e-3) << what;
  EXPECT_LT(r.error(from), v0 * after_ms * 1e-3 + v0 * v0 / (2 * a) + 0.02) << what;
  const Pose2 held = r.truth().X_WB;
  r.run(500);
  EXPECT_LT(r.error(held), 1e-3) << what;
  return stands_ms;
}

TEST(RobotIo, EverythingThatStopsItDoesSoAlongItsRamp) {
  const tasks::TrajectoryConfig limits;
  const double steep = limits.ramp_down_deceleration_m_per_s2;
  {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    expect_smooth_stop(r, "goal expires", 200, steep);
    EXPECT_EQ(r.health.fault, fault::kGoalExpired);
    EXPECT_EQ(r.out.telemetry.goals_expired, 1U);
  }
  {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    r.send({5, 0, 0}, 10s);
    r.link_alive = false;
    expect_smooth_stop(r, "link silent", r.config.link_silence_ms, steep);
    EXPECT_EQ(r.health.fault, fault::kLinkSilent);
  }
  {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    r.send({5, 0, 0}, 10s);
    r.in.link_closed = true;
    expect_smooth_stop(r, "link closed", 0, steep);
    EXPECT_EQ(r.health.fault, fault::kLinkSilent);
  }
  {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    r.send({5, 0, 0}, 10s);
    r.goal.engaged = 0;
    expect_smooth_stop(r, "not engaged", 0, limits.acceleration_m_per_s2);
  }
  for (const Mode m : {Mode::kHold, Mode::kRampDown}) {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    r.send({5, 0, 0}, 10s);
    r.mode.mode = m;
    expect_smooth_stop(r, "mode", 0, steep);
  }
}

// The bound of tasks/graph/safe_times.hpp: silence, two ticks, v / a, the motors' tail. From the
// speed limit in any direction, with and without the unkind effects, the true base must stand by
// then.
TEST(RobotIo, StandsWithin300MillisecondsOfTheLastWord) {
  const Pose2 ways[] = {{6, 0, 0}, {0, 6, 0}, {-4, -4, 0}, {5, 0, 3}, {0, 0, 3}};
  for (const bool hard : {false, true}) {
    for (const Pose2& way : ways) {
      RobotPlantConfig plant = hard ? hard_plant() : RobotPlantConfig{};
      Robot r(plant);
      drive(r, way, 1500);
      r.send(way, 10s);
      const auto& c = r.config;
      r.link_alive = false;
      int stands_ms = 0;
      for (int ms = 1; ms <= 1000; ++ms) {
        r.tick();
        const auto& v = r.truth().v_B;
        if (std::hypot(v.vx, v.vy) > 0.01 || std::abs(v.wz) > 0.02) stands_ms = ms;
      }
      const double bound_ms =
          c.link_silence_ms + 2 +
          1e3 * std::max(c.trajectory.speed_m_per_s / c.trajectory.ramp_down_deceleration_m_per_s2,
                         c.trajectory.yaw_rate_rad_per_s /
                             c.trajectory.ramp_down_yaw_deceleration_rad_per_s2) +
          1e3 * c.motor_settle_s;
      std::printf("way (%.0f %.0f %.0f) %s: stands after %d ms, bound %.0f ms\n", way.x, way.y,
                  way.yaw, hard ? "hard" : "plain", stands_ms, bound_ms);
      EXPECT_GT(stands_ms, c.link_silence_ms) << "it was moving";
      EXPECT_LE(stands_ms, bound_ms);
      EXPECT_LE(bound_ms, 300);
    }
  }
}

// Short of supervision's limit a silence only slows the base down: it goes on when the link is
// back.
TEST(RobotIo, AShortSilenceCostsSpeedAndNoEngage) {
  Robot r;
  drive(r, {5, 0, 0}, 1500);
  r.send({5, 0, 0}, 10s);
  r.link_alive = false;
  r.run(r.config.link_silence_ms + 60);
  EXPECT_EQ(r.health.fault, fault::kLinkSilent);
  EXPECT_LT(r.truth().v_B.vx, 0.35);
  r.link_alive = true;
  r.run(800);
  EXPECT_TRUE(r.health == rt::Health::ok());
  EXPECT_GT(r.truth().v_B.vx, 0.4);
}

TEST(RobotIo, SafeStopSwitchesOffAtOnce) {
  for (const Mode m : {Mode::kSafeStop, Mode::kInit}) {
    Robot r;
    drive(r, {5, 0, 0}, 2000);
    r.send({5, 0, 0}, 10s);
    r.mode.mode = m;
    r.mode.cause = 701;
    r.tick();
    EXPECT_EQ(r.out.state.mode_cause, 701) << "the operator's box names it";
    EXPECT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
    for (const double w : r.out.setpoints.wheel_rad_per_s) EXPECT_EQ(w, 0);
  }
}

TEST(RobotIo, DoesNotMoveBeforeItIsToldTo) {
  Robot r;
  r.in.goal = nullptr;
  r.run(300);
  EXPECT_EQ(r.truth().path_m, 0);
  r.in.mode = nullptr;
  r.send({1, 0, 0}, 10s);
  r.run(300);
  EXPECT_EQ(r.truth().path_m, 0);
  r.in.mode = &r.mode;
  r.link_alive = false;
  r.in.link_heard = false;
  r.run(300);
  EXPECT_EQ(r.truth().path_m, 0);
  r.link_alive = true;
  r.run(300);
  EXPECT_EQ(r.truth().path_m, 0) << "the goal is older than the engage";
  r.send({1, 0, 0}, 10s);
  r.run(300);
  EXPECT_GT(r.truth().path_m, 0);
}

TEST(RobotIo, NotANumberGoalIsRefusedAndTheOldOneHolds) {
  double RobotGoal::*const fields[] = {&RobotGoal::x_m, &RobotGoal::yaw_rad, &RobotGoal::vx,
                                       &RobotGoal::speed_limit_m_per_s};
  for (const auto field : fields) {
    Robot r;
    drive(r, {1, 0, 0}, 500);
    RobotGoal bad = r.goal;
    bad.seq += 1;
    bad.valid_until = r.now + 10s;
    bad.*field = std::nan("");
    r.in.goal = &bad;
    r.tick();
    EXPECT_EQ(r.health.fault, fault::kGoalRefused);
    EXPECT_EQ(r.out.state.goal_seq, r.goal.seq);
    r.run(2000);
    EXPECT_EQ(r.out.telemetry.goals_refused, 1U);
    EXPECT_TRUE(std::isfinite(r.out.state.cmd_vx));
    EXPECT_NEAR(r.truth().v_B.vx, 0, 1e-3);  // the old goal has expired
  }
}

TEST(RobotIo, LostFramesAreCountedABrokenBusIsASafeStop) {
  Robot r;
  drive(r, {3, 0, 0}, 1500);
  r.send({3, 0, 0}, 10s);
  r.bus.faults().lose_frames = 5;
  r.run(5);
  EXPECT_EQ(r.health.fault, fault::kFrameLost);
  EXPECT_EQ(r.health.severity, rt::Severity::kCounted);
  r.run(20);
  EXPECT_TRUE(r.health == rt::Health::ok());
  // Odometry bridged the gap: angles are absolute.
  EXPECT_NEAR(r.out.state.x_m, r.truth().X_WB.x, 1e-3);
  r.bus.faults().lose_frames = 1000;
  r.run(101);
  EXPECT_EQ(r.health.fault, fault::kBusDown);
  EXPECT_EQ(r.health.severity, rt::Severity::kSafeStop);
  EXPECT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
}

// What a clear of the operator does at the robot: supervision tells it with the mode.
void clear(Robot& r) {
  r.mode.mode = Mode::kSafeStop;
  r.run(10);
  r.mode.clear = true;
  r.run(10);
  r.mode.clear = false;
}

TEST(RobotIo, LatchedMotorWatchdogNeedsAClear) {
  Robot r;
  drive(r, {3, 0, 0}, 1500);
  r.now += 500ms;  // the box stalls
  r.send({3, 0, 0}, 100s);
  r.run(500);
  EXPECT_EQ(r.health.fault, fault::kMotorTimeout);
  const Pose2 held = r.truth().X_WB;
  r.run(500);
  EXPECT_LT(r.error(held), 1e-6);
  r.mode.mode = Mode::kHold;
  r.run(10);
  r.mode.mode = Mode::kEngaged;
  r.run(200);
  EXPECT_EQ(r.health.fault, fault::kMotorTimeout) << "an engage alone is not enough";
  EXPECT_LT(r.error(held), 1e-6);
  clear(r);
  EXPECT_TRUE(r.health == rt::Health::ok());
  r.run(200);
  EXPECT_LT(r.error(held), 1e-6) << "nor is a clear";
  r.mode.mode = Mode::kEngaged;
  r.run(200);
  EXPECT_LT(r.error(held), 1e-6) << "nor a goal from before it";
  r.send({3, 0, 0}, 100s);
  r.run(1000);
  EXPECT_GT(r.error(held), 0.2);
}

TEST(RobotIo, BrokenEncoderIsASafeStopUntilCleared) {
  Robot r;
  drive(r, {3, 0, 0}, 1500);
  r.send({3, 0, 0}, 100s);
  r.bus.faults().nan_angle = true;
  r.run(2);
  EXPECT_EQ(r.health.fault, fault::kEncoder);
  EXPECT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
  EXPECT_TRUE(std::isfinite(r.out.state.x_m));
  clear(r);
  EXPECT_EQ(r.health.fault, fault::kEncoder) << "still broken";
  r.bus.faults().nan_angle = false;
  r.run(200);
  EXPECT_EQ(r.health.severity, rt::Severity::kSafeStop) << "latched";
  clear(r);
  EXPECT_TRUE(r.health == rt::Health::ok());
  r.mode.mode = Mode::kEngaged;
  r.run(1);
  r.send({3, 0, 0}, 100s);
  r.run(500);
  EXPECT_TRUE(r.health == rt::Health::ok());
  EXPECT_GT(r.truth().v_B.vx, 0.2);
}

// Supervision looks every tenth tick: a safe stop that lasts for one is still there when it does.
TEST(RobotIo, ASafeStopIsReportedUntilSupervisionHasTakenItUp) {
  Robot r;
  drive(r, {3, 0, 0}, 1500);
  r.send({3, 0, 0}, 100s);
  r.bus.faults().down = true;
  r.tick();
  r.bus.faults().down = false;
  for (int i = 0; i < 10; ++i) {
    r.tick();
    ASSERT_EQ(r.health.fault, fault::kBusDown);
    ASSERT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
  }
  r.mode.mode = Mode::kSafeStop;
  r.run(2);
  EXPECT_TRUE(r.health == rt::Health::ok());
  EXPECT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
}

// A wheel that does not turn, whatever holds it: a safe stop after 100 ms.
TEST(RobotIo, StuckWheelStopsTheBase) {
  Robot r;
  drive(r, {5, 0, 0}, 1000);
  r.bus.faults().stuck_wheel = 0;
  int jobs = 0;
  for (; jobs < 200 && r.health.severity != rt::Severity::kSafeStop; ++jobs) {
    if (jobs % 100 == 0) r.send({5, 0, 0});
    r.tick();
    ASSERT_LE(std::hypot(r.out.state.cmd_vx, r.out.state.cmd_vy), 0.5 + 1e-9);
  }
  EXPECT_EQ(r.health.fault, fault::kEncoderStands);
  EXPECT_EQ(r.out.bus.wheel, 0);
  EXPECT_GE(jobs, 100);
  EXPECT_LE(jobs, 103);
  EXPECT_EQ(r.out.setpoints.mode, drivers::MotorMode::kStop);
}

// Motors too weak for the acceleration limit: the base lags, and that is no fault of a wheel.
TEST(RobotIo, ABaseThatLagsIsReported) {
  RobotPlantConfig weak;
  weak.torque_limit_Nm = 0.3;
  Robot r(weak);
  bool seen = false;
  for (int i = 0; i < 2000; ++i) {
    if (i % 100 == 0) r.send({5, 0, 0});
    r.tick();
    seen = seen || r.health.fault == fault::kTracking;
    ASSERT_LT(r.health.severity, rt::Severity::kSafeStop) << i;
  }
  EXPECT_TRUE(seen);
}

TEST(RobotIo, SameInputSameBytes) {
  std::uint64_t digest[2];
  for (std::uint64_t& d : digest) {
    rt::Hash64 h;
    Robot r(hard_plant());
    for (int ms = 0; ms < 3000; ++ms) {
      if (ms % 100 == 0) r.send({1, 0.5 * (ms % 300), 1});
      r.tick();
      for (const double w : r.out.setpoints.wheel_rad_per_s) h.value(w);
      h.value(r.out.state.x_m);
    }
    d = h.digest();
  }
  EXPECT_EQ(digest[0], digest[1]);
}

TEST(RobotIo, ContradictingLimitsAreRefused) {
  rt::Startup startup;
  RobotIoConfig c;
  c.wheel_speed_limit_rad_per_s = 5;
  EXPECT_THROW(RobotIoTask(startup.token(), c), std::invalid_argument);
}

}  // namespace
