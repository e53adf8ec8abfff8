// Motors that were off start from what their wheels do: a thousand stops at random moments.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/random.hpp"
#include "tasks/robot_io/robot_io_task.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::MotorMode;
using tasks::Mode;

// One stop: how the base got there, and how it is taken out of it.
enum class Kind { kMode, kLostBus, kEncoder, kWatchdog };

struct Box {
  rt::Startup startup;
  tasks::RobotIoConfig config;
  drivers::VirtualYoubot bus{startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  tasks::RobotIoTask task{startup.token(), config};
  tasks::RobotIoTask::In in;
  tasks::RobotIoTask::Out out;
  tasks::ModeMsg mode;
  drivers::RobotGoal goal;
  rt::Time now = rt::time_from_ns(1'000'000'000);
  std::array<double, 4> wheels_sensed{};  // true speeds when the job read them

  void send(rt::Random& random) {
    ++goal.seq;
    goal.made = now;
    goal.valid_until = now + 100s;
    goal.x_m = random.uniform(-3, 3);
    goal.y_m = random.uniform(-3, 3);
    goal.yaw_rad = random.uniform(-3, 3);
    goal.speed_limit_m_per_s = 0.5;
    goal.engaged = 1;
  }
  void job() {
    rt::Tick t;
    t.release = t.start = now;
    t.period = 1ms;
    in.mode = &mode;
    in.goal = &goal;
    in.link_heard = true;
    in.link_heard_at = now;
    in.bus = bus.sense(now, in.motors);
    wheels_sensed = bus.plant().state().wheel_rad_per_s;
    (void)task.step(t, in, out);
    if (out.rearm_motors) bus.rearm();
    in.sent = bus.act(now, out.setpoints);
    now += 1ms;
  }
  void jobs(std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) job();
  }
  [[nodiscard]] bool powered() const { return out.setpoints.mode == MotorMode::kVelocity; }
};

void stop(Box& b, Kind kind) {
  if (kind == Kind::kLostBus) b.bus.faults().lose_frames = 120;
  if (kind == Kind::kEncoder) b.bus.faults().nan_angle = true;
  if (kind == Kind::kWatchdog) b.now += 150ms;
  if (kind == Kind::kMode) b.mode.mode = Mode::kSafeStop;
  b.jobs(kind == Kind::kLostBus ? 130 : 2);
  b.bus.faults() = {};
  ASSERT_FALSE(b.powered());
  b.mode.mode = Mode::kSafeStop;
}

TEST(RobotIoRestart, FirstSetpointStepIsZeroAndOlderGoalsAreVoid) {
  constexpr std::uint64_t kSeed = 22;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  Box b;
  b.mode.mode = Mode::kEngaged;
  b.job();
  int turning = 0;
  for (int n = 0; n < 1000; ++n) {
    b.send(random);
    b.jobs(random.integer(1, 600));
    ASSERT_TRUE(b.powered()) << n;
    stop(b, static_cast<Kind>(random.integer(0, 3)));
    if (HasFatalFailure()) return;
    b.jobs(random.integer(1, 40));
    if (random.integer(0, 1) == 1) b.send(random);  // made while it stands: void as well
    b.mode.clear = true;
    b.jobs(random.integer(1, 3));
    b.mode.clear = false;
    ASSERT_FALSE(b.powered()) << n;
    // Engaged at once or by way of hold; the old goal lies there all the time.
    if (random.integer(0, 1) == 1)
      b.mode.mode = Mode::kHold;
    else
      b.mode.mode = Mode::kEngaged;
    b.job();
    ASSERT_TRUE(b.powered()) << n;
    bool moved = false;
    for (std::size_t w = 0; w < 4; ++w) {
      ASSERT_EQ(b.out.setpoints.wheel_rad_per_s[w], b.wheels_sensed[w]) << n;
      moved = moved || std::abs(b.wheels_sensed[w]) > 0.1;
    }
    turning += moved ? 1 : 0;
    // What follows stays within the limit from there, and only a new goal makes it move.
    b.mode.mode = Mode::kEngaged;
    const double step = b.config.trajectory.ramp_down_deceleration_m_per_s2 * 1e-3 / 0.0475;
    for (int i = 0; i < 300; ++i) {
      const auto before = b.out.setpoints.wheel_rad_per_s;
      b.job();
      for (std::size_t w = 0; w < 4; ++w)
        ASSERT_LE(std::abs(b.out.setpoints.wheel_rad_per_s[w] - before[w]), 4 * step) << n;
    }
    const auto& v = b.bus.plant().state().v_B;
    ASSERT_LT(std::hypot(v.vx, v.vy), 0.25) << n << ": the old goal drives";
    ASSERT_FALSE(b.out.telemetry.driving);
  }
  std::printf("%d of 1000 with wheels that still turned\n", turning);
  EXPECT_GT(turning, 50);
}

}  // namespace
