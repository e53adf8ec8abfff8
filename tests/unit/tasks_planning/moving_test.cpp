// Something that moves in the way: a goal waits for it or goes round it, and is not given up for
// it.
#include "tests/unit/tasks_planning/story.hpp"

namespace tests {
namespace {

// A block of cells that something moves in, as fusion publishes it: occupied, and in the list.
// Without inflation.
void moves(Story& s, double x0, double y0, double x1, double y1) {
  const auto cell = [](double v) { return static_cast<int>(std::floor((v + 3) / 0.05)); };
  s.box(x0, y0, x1, y1);
  for (int y = cell(y0); y <= cell(y1); ++y)
    for (int x = cell(x0); x <= cell(x1); ++x)
      s.map->moving[static_cast<std::size_t>(s.map->moving_count++)] = {
          static_cast<std::uint16_t>(s.map->index(x, y)), 30};
}
void gone(Story& s) {
  for (int i = 0; i < s.map->moving_count; ++i)
    s.map->cost[s.map->moving[static_cast<std::size_t>(i)].cell] = CostMap::kFree;
  s.map->moving_count = 0;
}
// The robot stands where its path ends.
void arrive(Story& s) {
  s.robot.x_m = s.last()[0];
  s.robot.y_m = s.last()[1];
}

TEST(PlanningMoving, AGoalWaitsUntilTheWayIsFree) {
  Story s;
  moves(s, -0.1, -3, 0.05, 2.99);
  s.mark({1.5, 0, 0}).job();
  EXPECT_TRUE(s.out.flags & PlanningTask::kWaits);
  EXPECT_EQ(s.out.state.phase, Phase::kPlanning);
  EXPECT_EQ(s.out.path.seq, 0U);
  for (int i = 0; i < 100; ++i) s.job();
  EXPECT_EQ(s.out.state.failures, 0U);
  gone(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  s.expect_path_sound();
}

TEST(PlanningMoving, ButNotForEver) {
  Story s;
  PlanningConfig config;
  config.moving_jobs = 20;
  PlanningTask task(startup.token(), config, 1);
  moves(s, -0.1, -3, 0.05, 2.99);
  s.mark({1.5, 0, 0});
  for (int i = 0; i < 20; ++i) {
    ++s.tick.k;
    (void)task.step(s.tick, s.in, s.out);
    s.in.event_count = 0;
    ASSERT_EQ(s.out.state.phase, Phase::kPlanning) << i;
  }
  ++s.tick.k;
  s.health = task.step(s.tick, s.in, s.out);
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningNoPath);
}

// A wall that stands is no reason to wait.
TEST(PlanningMoving, WhatStandsInTheWayIsNotWaitedFor) {
  Story s;
  s.box(-0.1, -3, 0.05, 2.99);
  s.mark({1.5, 0, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
}

TEST(PlanningMoving, APathThatItStepsIntoIsWithdrawnInTheSameJob) {
  Story s;
  s.mark({1.5, 0, 0}).job();
  const auto first = s.out.path.seq;
  ASSERT_NE(first, 0U);
  moves(s, -0.1, -3, 0.05, 2.99);
  s.job();
  EXPECT_EQ(s.out.path.seq, 0U);
  EXPECT_TRUE(s.out.flags & PlanningTask::kPathDropped);
  EXPECT_TRUE(s.out.flags & PlanningTask::kWaits);
  gone(s);
  s.job();
  EXPECT_GT(s.out.path.seq, first);
  // Not across the whole room: there is a way round, in the same job.
  const auto at = s.out.path.points[static_cast<std::size_t>(s.out.path.size / 2)];
  moves(s, at[0] - 0.2, at[1] - 0.2, at[0] + 0.2, at[1] + 0.2);
  const auto before = s.out.path.seq;
  s.job();
  EXPECT_GT(s.out.path.seq, before);
  s.expect_path_sound();
}

// Somebody stands on the goal's place: the base comes as near as it can, waits there, and goes on.
TEST(PlanningMoving, TheSecondBestPlaceIsLeftAgain) {
  Story s;
  moves(s, 1.2, -0.3, 1.8, 0.3);
  s.mark({1.5, 0, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_GT(std::hypot(s.last()[0] - 1.5, s.last()[1]), 0.3);
  arrive(s);
  for (int i = 0; i < 30; ++i) s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving) << "it waits";
  gone(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_LT(std::hypot(s.last()[0] - 1.5, s.last()[1]), 0.05);
  arrive(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
}

// The room is cut in two by somebody who walks; the mark's side is out of reach, a cell on this one
// is within the goal's radius of the mark. There the base does not go.
TEST(PlanningMoving, ItDoesNotDriveOffToTheFarSideOfAWall) {
  Story s;
  s.box(0.2, -3, 0.4, 1.0);  // a wall with an opening
  s.mark({0.9, 0, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  moves(s, 0.2, 1.05, 0.4, 2.99);
  for (int i = 0; i < 20; ++i) {
    s.job();
    ASSERT_EQ(s.out.path.seq, 0U) << i;
    ASSERT_TRUE(s.out.flags & PlanningTask::kWaits);
  }
  gone(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_LT(std::hypot(s.last()[0] - 0.9, s.last()[1]), 0.05);
}

TEST(PlanningMoving, WhoeverMovesElsewhereDelaysNoArrival) {
  Story s;
  s.box(1.2, -0.3, 1.8, 0.3);  // what is marked stands: its place is never the goal's
  moves(s, -2.8, 2.0, -2.5, 2.5);
  s.mark({1.5, 0, 0.4}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  arrive(s);
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
}

}  // namespace
}  // namespace tests
