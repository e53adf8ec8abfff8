// From marks to a path.
#include <cstring>
#include <vector>

#include "tests/unit/tasks_planning/story.hpp"

namespace tests {
namespace {

TEST(PlanningTask, NothingHappensWithoutAMark) {
  Story s;
  for (int i = 0; i < 20; ++i) s.job();
  EXPECT_EQ(s.out.path.seq, 0U);
  EXPECT_EQ(s.out.path.size, 0);
  EXPECT_EQ(s.out.state.phase, Phase::kIdle);
  EXPECT_EQ(s.out.state.seq, 20U);
  EXPECT_EQ(s.health, rt::Health::ok());
}

TEST(PlanningTask, AMarkBecomesAPathThatIsDrivenToItsEnd) {
  Story s;
  s.box(-1, -1, 0, 0);
  s.event(Kind::kContactBegin, {1, 2, 0}).mark({1, 2, 0}).job();
  EXPECT_EQ(s.health, rt::Health::ok());
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_EQ(s.out.state.marks, 1U);
  EXPECT_EQ(s.out.state.paths, 1U);
  EXPECT_EQ(s.out.path.seq, 1U);
  EXPECT_EQ(s.out.path.mark_seq, 2U);
  EXPECT_TRUE(s.out.flags & PlanningTask::kNewPath);
  EXPECT_TRUE(s.out.flags & PlanningTask::kMarkTaken);
  s.expect_path_sound();
  EXPECT_EQ(s.out.path.points[0][0], -2);
  EXPECT_NEAR(s.last()[0], 1, 1e-12);
  EXPECT_NEAR(s.last()[1], 2, 1e-12);
  const Path first = s.out.path;
  // Published again, unchanged, while the robot follows it.
  for (int i = 0; i < first.size; i += 3) {
    s.robot.x_m = first.points[static_cast<std::size_t>(i)][0];
    s.robot.y_m = first.points[static_cast<std::size_t>(i)][1];
    s.robot.vx = 0.3;
    s.job();
    EXPECT_EQ(s.out.path.seq, first.seq);
    EXPECT_EQ(s.out.path.points, first.points);
    EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  }
  s.robot.x_m = s.last()[0];
  s.robot.y_m = s.last()[1];
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving) << "still moving";
  s.robot.vx = 0;
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
  EXPECT_EQ(s.out.path.seq, first.seq) << "the goal is held";
}

TEST(PlanningTask, AMarkOnAnObstacleIsLookedAtFromItsFront) {
  Story s;
  s.box(0.5, -1, 1.0, 1);  // a cupboard
  s.box(0.3, -1.2, 1.2, 1.2, CostMap::kInscribed);
  s.box(0.5, -1, 1.0, 1);
  s.mark({1.0, 0, 0.7}, {1, 0, 0}).job();  // on its far side
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  s.expect_path_sound();
  EXPECT_GT(s.last()[0], 1.0) << "the side the marked surface faces";
  EXPECT_NEAR(s.last()[1], 0, 0.1);
  EXPECT_NEAR(std::abs(s.last()[2]), std::numbers::pi, 0.1) << "looks back at the mark";
  s.mark({0.5, 0, 0.7}, {-1, 0, 0}).job();
  EXPECT_LT(s.last()[0], 0.5);
  EXPECT_NEAR(s.last()[2], 0, 0.1);
  EXPECT_EQ(s.out.path.seq, 2U);
}

TEST(PlanningTask, AStrokeMeansTheDrawnPointNearestToItsMean) {
  Story s;
  s.event(Kind::kMarkBegin, {0, 0, 0});
  for (int i = 0; i < 60; ++i) s.event(Kind::kMarkPoint, {0.01 * i, 0, 0});
  s.event(Kind::kMarkEnd, {0.6, 0, 0}).job();
  EXPECT_NEAR(s.out.path.marked_W.x(), 0.3, 0.011);
  // Longer than the store: thinned, still near the mean.
  s.event(Kind::kMarkBegin, {0, 1, 0}).job();
  for (int j = 0; j < 10; ++j) {
    for (int i = 0; i < 60; ++i) s.event(Kind::kMarkPoint, {0.001 * (60 * j + i), 1, 0});
    s.job();
    EXPECT_FALSE(s.out.flags & PlanningTask::kMarkTaken);
  }
  s.event(Kind::kMarkEnd, {0.6, 1, 0}).job();
  EXPECT_TRUE(s.out.flags & PlanningTask::kMarkTaken);
  EXPECT_NEAR(s.out.path.marked_W.x(), 0.3, 0.011);
}

TEST(PlanningTask, AGapDropsTheOpenMark) {
  Story s;
  s.event(Kind::kMarkBegin, {1, 1, 0}).job();
  s.event(Kind::kMarkEnd, {1, 1, 0}, {0, 0, 1}, true).job();
  EXPECT_TRUE(s.out.flags & PlanningTask::kGapDropped);
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningEventsLost);
  EXPECT_EQ(s.out.state.marks, 0U);
  EXPECT_EQ(s.out.path.seq, 0U);
  // The next whole mark counts again, even one whose begin carries the flag.
  s.event(Kind::kMarkBegin, {1, 1, 0}).job();
  s.event(Kind::kMarkBegin, {2, 1, 0}, {0, 0, 1}, true).event(Kind::kMarkEnd, {2, 1, 0}).job();
  EXPECT_EQ(s.out.state.marks, 1U);
  EXPECT_NEAR(s.last()[0], 2, 1e-9);
}

TEST(PlanningTask, DuplicatesLoneEndsAndNonsenseAreNoMarks) {
  Story s;
  s.event(Kind::kMarkEnd, {1, 1, 0}).event(Kind::kMarkPoint, {1, 1, 0}).job();
  EXPECT_EQ(s.out.state.marks, 0U);
  s.mark({1, 1, 0});
  s.in.events[3] = s.in.events[0];  // the same three again, late
  s.in.events[4] = s.in.events[2];
  s.in.event_count = 5;
  s.job();
  EXPECT_EQ(s.out.state.marks, 1U);
  s.mark({std::nan(""), 1, 0}).job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningBadInput);
  EXPECT_EQ(s.out.state.marks, 1U);
  s.mark({1e12, 1, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  s.in.event_count = 1 << 20;  // clipped
  s.job();
}

TEST(PlanningTask, MovingABoxChangesThePath) {
  Story a, b;
  a.box(-1.2, -1.5, -0.2, 0.5);
  b.box(-1.2, -0.5, -0.2, 1.5);
  a.mark({1, 0, 0}).job();
  b.mark({1, 0, 0}).job();
  ASSERT_GT(a.out.path.size, 0);
  ASSERT_GT(b.out.path.size, 0);
  a.expect_path_sound();
  b.expect_path_sound();
  EXPECT_NE(a.out.path.points, b.out.path.points);
}

TEST(PlanningTask, HeadingsTurnGraduallyAndEndAtTheMark) {
  Story s;
  s.robot.yaw_rad = std::numbers::pi;  // looks away
  s.box(1.9, -0.2, 2.3, 0.2, CostMap::kInscribed);
  s.mark({1.9, 0, 0.3}, {-1, 0, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  const Path& p = s.out.path;
  EXPECT_NEAR(std::abs(p.points[0][2]), std::numbers::pi, 1e-9);
  for (int i = 1; i < p.size; ++i) {
    const auto& a = p.points[static_cast<std::size_t>(i - 1)];
    const auto& b = p.points[static_cast<std::size_t>(i)];
    const double ds = std::hypot(b[0] - a[0], b[1] - a[1]);
    EXPECT_LE(std::abs(std::remainder(b[2] - a[2], 2 * std::numbers::pi)), 2 * 3.0 * ds + 1e-9);
  }
  EXPECT_NEAR(s.last()[2], 0, 0.15);
}

TEST(PlanningTask, TiltedAndTurnedGroundIsNoProblemUpToALimit) {
  Story s;
  s.box(-1, -1, 0, 0);
  s.map->X_WM = perception::Pose::Identity();
  s.map->X_WM.linear() =
      (Eigen::AngleAxisd(0.05, Vec3::UnitX()) * Eigen::AngleAxisd(0.7, Vec3::UnitZ()))
          .toRotationMatrix();
  s.map->X_WM.translation() = s.map->X_WM.linear() * Vec3(-3, -3, 0) + Vec3(0, 0, 0.3);
  s.mark({1, 1, 0.3}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_NEAR(s.last()[0], 1, 0.02);
  EXPECT_NEAR(s.last()[1], 1, 0.02);
  s.map->X_WM.linear() = Eigen::AngleAxisd(1.2, Vec3::UnitX()).toRotationMatrix();
  s.mark({1, 0, 0.3}).job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningBadInput);
  EXPECT_EQ(s.out.path.seq, 0U);
}

TEST(PlanningTask, SameInputsSameBytes) {
  const auto run = [](std::vector<Path>& paths) {
    Story s;
    rt::Random r(9);
    for (int i = 0; i < 60; ++i) {
      if (i % 5 == 0) s.mark({r.uniform(-2.5, 2.5), r.uniform(-2.5, 2.5), 0});
      if (i % 7 == 0) {
        const double x = r.uniform(-2, 2), y = r.uniform(-2, 2);
        if (std::hypot(x - s.robot.x_m, y - s.robot.y_m) > 0.8) s.box(x, y, x + 0.4, y + 0.1);
      }
      s.job();
      paths.push_back(s.out.path);
      if (s.out.path.size > 4) {
        s.robot.x_m = s.out.path.points[4][0];
        s.robot.y_m = s.out.path.points[4][1];
      }
    }
  };
  std::vector<Path> a, b;
  run(a);
  run(b);
  int with_path = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].seq, b[i].seq);
    EXPECT_EQ(0, std::memcmp(a[i].points.data(), b[i].points.data(), sizeof a[i].points));
    with_path += a[i].size > 0;
  }
  EXPECT_GT(with_path, 30);
}

}  // namespace
}  // namespace tests
