// robot_io through the EtherCAT master and the virtual chain: it drives as it does without, the
// same bytes twice, and a wire that fails is a fault of the bus.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "drivers/youbot/virtual_youbot.hpp"
#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/hash.hpp"
#include "tasks/robot_io/robot_io_task.hpp"

namespace {

using namespace std::chrono_literals;
using perception::Pose2;
using tasks::Mode;
namespace fault = tasks::robot_io_fault;

struct Base {
  rt::Startup startup;
  tasks::RobotIoConfig config;
  drivers::VirtualYoubot robot{
      startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  std::unique_ptr<drivers::youbot_bus::EtherCatTwinBus> wire;
  drivers::MotorBus* bus = &robot;
  tasks::RobotIoTask task{startup.token(), config};
  tasks::RobotIoTask::In in;
  tasks::RobotIoTask::Out out;
  tasks::ModeMsg mode;
  drivers::RobotGoal goal;
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  rt::Hash64 hash;
  rt::Health health;

  explicit Base(bool through_chain) {
    mode.mode = Mode::kEngaged;
    if (!through_chain) return;
    wire = std::make_unique<drivers::youbot_bus::EtherCatTwinBus>(startup.token(), robot);
    bus = wire.get();
  }
  void job() {
    rt::Tick t;
    t.release = t.start = now;
    t.period = 1ms;
    in.mode = &mode;
    in.goal = goal.seq > 0 ? &goal : nullptr;
    in.link_heard = true;
    in.link_heard_at = now;
    in.bus = bus->sense(now, in.motors);
    health = task.step(t, in, out);
    if (out.rearm_motors) bus->rearm();
    in.sent = bus->act(now + 50us, out.setpoints);
    for (const double w : out.setpoints.wheel_rad_per_s) hash.value(w);
    for (const double w : in.motors.wheel_rad) hash.value(w);
    now += 1ms;
  }
  // A goal renewed at 10 Hz, as prediction does.
  void drive(const Pose2& p, int ms) {
    for (int i = 0; i < ms; ++i) {
      if (i % 100 == 1) {
        ++goal.seq;
        goal.made = now;
        goal.valid_until = now + 300ms;
        goal.x_m = p.x;
        goal.y_m = p.y;
        goal.yaw_rad = p.yaw;
        goal.speed_limit_m_per_s = 0.5;
        goal.engaged = 1;
      }
      job();
    }
  }
  [[nodiscard]] double error(const Pose2& p) const {
    const Pose2& X = robot.plant().state().X_WB;
    return std::hypot(X.x - p.x, X.y - p.y);
  }
};

// A square of 4 m with turns, no slip: the truth is the plant's own integral.
TEST(RobotIoChain, ASquareThroughTheChainEndsWhereItShould) {
  const std::array<Pose2, 5> corners{{{4, 0, 0}, {4, 4, 1.5}, {0, 4, 3}, {0, 0, -1.5}, {0, 0, 0}}};
  std::array<std::uint64_t, 2> digest{};
  for (std::size_t again = 0; again < 2; ++again) {
    Base chain(true), direct(false);
    for (const Pose2& p : corners) {
      chain.drive(p, 12000);
      if (again == 0) direct.drive(p, 12000);
      EXPECT_LE(chain.error(p), 0.005) << "goal error";
      const Pose2& X = chain.robot.plant().state().X_WB;
      const double off = std::hypot(X.x - chain.out.state.x_m, X.y - chain.out.state.y_m);
      EXPECT_LE(off, 0.001) << "odometry against the truth";
      if (again == 0)
        std::printf("goal error %.2f mm (without a chain %.2f mm), odometry off %.3f mm\n",
                    1e3 * chain.error(p), 1e3 * direct.error(p), 1e3 * off);
    }
    EXPECT_EQ(chain.wire->master().counters().lost, 0U);
    EXPECT_EQ(chain.out.telemetry.frames_lost, 0U);
    digest[again] = chain.hash.digest();
  }
  EXPECT_EQ(digest[0], digest[1]) << "the same bytes twice";
}

// What the wire loses is counted, and either frame of a job is enough.
TEST(RobotIoChain, LostFramesAreCountedAndAHundredInARowStop) {
  Base b(true);
  b.drive({3, 0, 0}, 1500);
  b.wire->port().faults().lose_back = 1;
  b.job();
  EXPECT_EQ(b.health.fault, fault::kFrameLost);
  EXPECT_EQ(b.health.severity, rt::Severity::kCounted);
  b.job();
  EXPECT_EQ(b.out.telemetry.frames_lost, 1U);
  // Every second frame is lost: each job's read comes back, none of its writes does.
  int jobs = 0;
  for (; jobs < 150 && b.health.severity != rt::Severity::kSafeStop; ++jobs) {
    b.in.sent = drivers::BusStatus::kFrameLost;
    rt::Tick t;
    t.release = t.start = b.now;
    t.period = 1ms;
    b.in.link_heard_at = b.now;
    b.in.bus = b.bus->sense(b.now, b.in.motors);
    b.health = b.task.step(t, b.in, b.out);
    b.wire->port().faults().lose_out = 1;
    (void)b.bus->act(b.now, b.out.setpoints);
    b.now += 1ms;
  }
  EXPECT_GE(jobs, b.config.frames_lost_limit - 1);
  EXPECT_EQ(b.health.fault, fault::kBusDown);
}

}  // namespace
