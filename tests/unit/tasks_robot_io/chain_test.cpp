// robot_io through the EtherCAT master and the virtual chain: it drives as it does without, the
// same bytes twice, and a wire that fails is a fault of the bus.
#include <numbers>

#include "tests/unit/tasks_robot_io/chain_rig.hpp"
#include "tests/unit/tasks_robot_io/roller_truth.hpp"

namespace tests {
namespace {

// A square of 4 m with turns, no slip: here the truth is the plant's own integral.
TEST(RobotIoChain, ASquareThroughTheChainEndsWhereItShould) {
  const std::array<Pose2, 5> corners{{{4, 0, 0}, {4, 4, 1.5}, {0, 4, 3}, {0, 0, -1.5}, {0, 0, 0}}};
  std::array<std::uint64_t, 2> digest{};
  for (std::size_t again = 0; again < 2; ++again) {
    Base chain(true), direct(false);
    for (const Pose2& p : corners) {
      chain.drive(p, 12000);
      if (again == 0) direct.drive(p, 12000);
      EXPECT_LE(chain.error(p), 0.005) << "goal error";
      const Pose2& X = chain.truth();
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

// The same against a truth that shares no code with odometry or plant: the wheels' true angles and
// where their rollers touch the floor.
TEST(RobotIoChain, TheSquaresOdometryAgreesWithTheRollersOnTheFloor) {
  const std::array<Pose2, 5> corners{{{4, 0, 0}, {4, 4, 1.5}, {0, 4, 3}, {0, 0, -1.5}, {0, 0, 0}}};
  Base b(true);
  b.job();
  RollerTruth floor(b.robot.plant().state().wheel_rad);
  double worst_m = 0, worst_rad = 0, way_m = 0;
  for (const Pose2& p : corners) {
    for (int i = 0; i < 12000; ++i) {
      if (i % 100 == 1) b.send(p);
      const double x = floor.x_m, y = floor.y_m;
      b.job();
      floor.see(b.robot.plant().state().wheel_rad);
      way_m += std::hypot(floor.x_m - x, floor.y_m - y);
      // Odometry is of the job's read; the wheels went on until its write.
      const double moved = std::hypot(b.out.state.vx, b.out.state.vy) * 1e-3;
      const double off = std::hypot(floor.x_m - b.out.state.x_m, floor.y_m - b.out.state.y_m);
      worst_m = std::max(worst_m, off - moved);
      worst_rad = std::max(worst_rad, std::abs(std::remainder(floor.yaw_rad - b.out.state.yaw_rad,
                                                              2 * std::numbers::pi)));
    }
    EXPECT_NEAR(floor.x_m, p.x, 0.005);
    EXPECT_NEAR(floor.y_m, p.y, 0.005);
  }
  EXPECT_GT(way_m, 15.9);
  EXPECT_LE(worst_m, 0.001);
  EXPECT_LE(worst_rad, 0.002);
  std::printf("way %.2f m; odometry at most %.3f mm and %.3f mrad off\n", way_m, 1e3 * worst_m,
              1e3 * worst_rad);
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
    rt::Tick t;
    t.release = t.start = b.now;
    t.period = 1ms;
    b.in.link_heard_at = b.now;
    b.in.sent = b.sent;
    b.in.bus = b.bus->sense(b.now, b.in.motors);
    b.health = b.task.step(t, b.in, b.out);
    b.wire->port().faults().lose_out = 1;
    b.sent = b.bus->act(b.now, b.out.setpoints);
    b.now += 1ms;
  }
  EXPECT_GE(jobs, b.config.frames_lost_limit - 1);
  EXPECT_EQ(b.health.fault, fault::kBusDown);
}

}  // namespace
}  // namespace tests
