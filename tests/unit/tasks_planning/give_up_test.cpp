// What ends a goal or keeps it waiting: no way, no input, a stop, no time.
#include "tests/unit/tasks_planning/story.hpp"

namespace tests {
namespace {

using Failure = tasks::TaskState::Failure;

TEST(PlanningTask, GivesUpWhatIsUnreachable) {
  Story s;
  s.box(0, -3, 0.05, 2.99, CostMap::kUnknown);
  s.mark({2.5, 0, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.out.state.failures, 1U);
  EXPECT_EQ(s.out.status, PlanStatus::kUnreachable);
  EXPECT_EQ(s.out.state.failure, Failure::kNoWay);
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningNoPath);
  EXPECT_EQ(s.out.path.seq, 0U);
  s.job();
  EXPECT_EQ(s.out.state.failures, 1U) << "a new try needs a new mark";
  s.mark({-1, 1, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_EQ(s.out.state.failure, Failure::kNo);
}

TEST(PlanningTask, WaitsForMapAndRobotButNotForever) {
  Story s;
  s.in.map = nullptr;
  s.mark({1, 1, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kPlanning);
  s.in.map = s.map.get();
  s.in.robot = nullptr;
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kPlanning);
  s.in.robot = &s.robot;
  s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  s.in.map = nullptr;
  s.mark({2, 1, 0}).job();
  for (int i = 0; i < 60; ++i) s.job();
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.out.state.failure, Failure::kNoMap);
  s.in.map = s.map.get();
  s.robot.x_m = std::nan("");
  s.mark({1, 1, 0}).job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningBadInput);
  EXPECT_EQ(s.out.path.seq, 0U);
}

TEST(PlanningTask, StartsFromFloorTheCameraCanNotSee) {
  Story s;
  s.box(-2.5, -2.5, -1.5, -1.5, CostMap::kUnknown);  // round the robot
  s.mark({1, 1, 0}).job();
  ASSERT_EQ(s.out.state.phase, Phase::kDriving);
  EXPECT_TRUE(s.out.flags & PlanningTask::kEscape);
  EXPECT_EQ(s.out.path.points[0][0], -2);
  const auto seq = s.out.path.seq;
  s.job();
  EXPECT_EQ(s.out.path.seq, seq) << "the unseen leg does not make it plan again";
  // An obstacle on that leg does.
  const auto leg = s.out.path.points[8];
  s.box(leg[0], leg[1], leg[0], leg[1]);
  s.job();
  EXPECT_NE(s.out.path.seq, seq);
  // Unseen floor farther than the radius is no start.
  Story far;
  far.box(-3, -3, -0.9, -0.9, CostMap::kUnknown);
  far.mark({1, 1, 0}).job();
  EXPECT_EQ(far.out.status, PlanStatus::kStartBlocked);
  EXPECT_EQ(far.out.state.failure, Failure::kStart);
}

TEST(PlanningTask, AStopDropsMarkAndPath) {
  Story s;
  s.mark({1, 1, 0}).job();
  ASSERT_NE(s.out.path.seq, 0U);
  s.in.mode.seq = 1;
  s.in.mode.mode = Mode::kSafeStop;
  s.job();
  EXPECT_EQ(s.out.path.seq, 0U);
  EXPECT_EQ(s.out.state.phase, Phase::kIdle);
  s.event(Kind::kMarkBegin, {1, 1, 0}).job();
  s.in.mode.mode = Mode::kHold;
  s.event(Kind::kMarkEnd, {1, 1, 0}).job();
  EXPECT_EQ(s.out.state.marks, 1U) << "a mark that began during the stop is none";
  s.mark({1, 1, 0}).job();
  EXPECT_NE(s.out.path.seq, 0U);
}

TEST(PlanningTask, AnAbortedJobLeavesNoTrace) {
  Story s, reference;
  rt::CancelToken token;
  s.tick.cancel = reference.tick.cancel = &token;
  for (auto* t : {&s, &reference}) t->box(-1, -1, 0, 0), t->job();
  token.request();
  s.mark({1, 1, 0});
  const auto events = s.in.events;
  s.job();
  EXPECT_EQ(s.out.status, PlanStatus::kCancelled);
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningCancelled);
  s.task.abandon();
  token.clear();
  reference.tick.k++;
  reference.tick.start += std::chrono::milliseconds(100);
  // The same events again, as the executor hands them to the next job.
  s.in.events = reference.in.events = events;
  s.in.event_count = reference.in.event_count = 3;
  s.job();
  reference.job();
  EXPECT_EQ(s.out.path.points, reference.out.path.points);
  EXPECT_EQ(s.out.state.marks, 1U);
  EXPECT_EQ(s.out.state.seq, 2U);
}

// One job as the executor runs it that is out of time: cancelled, abandoned, its events kept.
void out_of_time(Story& s, PlanningTask& task, rt::CancelToken& token) {
  const auto events = s.in.events;
  const int count = s.in.event_count;
  token.request();
  ++s.tick.k;
  s.health = task.step(s.tick, s.in, s.out);
  ASSERT_EQ(s.health.fault, tasks::kFaultPlanningCancelled);
  task.abandon();
  token.clear();
  s.in.events = events;
  s.in.event_count = count;
}

TEST(PlanningTask, AGoalOutOfTimeAgainAndAgainIsGivenUp) {
  Story s;
  PlanningConfig config;
  config.aborts = 4;
  PlanningTask task(startup.token(), config, 1);
  rt::CancelToken token;
  s.tick.cancel = &token;
  s.box(-1, -1, 0, 0);
  const auto job = [&] {
    ++s.tick.k;
    s.health = task.step(s.tick, s.in, s.out);
    s.in.event_count = 0;
  };
  s.mark({1, 1, 0});
  for (int i = 0; i < config.aborts; ++i) out_of_time(s, task, token);
  // The machine has time again, but nobody waits for this mark any more.
  job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningNoTime);
  EXPECT_EQ(s.health.severity, rt::Severity::kCounted);
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.out.state.failures, 1U);
  EXPECT_EQ(s.out.path.seq, 0U);
  EXPECT_NE(s.out.flags & PlanningTask::kGivenUp, 0U);
  job();
  EXPECT_EQ(s.health, rt::Health::ok()) << "reported once";
  EXPECT_EQ(s.out.flags & PlanningTask::kGivenUp, 0U);
  // The next mark has its own tries: one fewer than the bound, then a path.
  s.mark({1, -1, 0});
  for (int i = 0; i < config.aborts - 1; ++i) out_of_time(s, task, token);
  job();
  EXPECT_NE(s.out.path.seq, 0U);
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
  // A job that was not aborted ends the row: the count begins anew when the way is blocked later.
  const auto at = s.out.path.points[static_cast<std::size_t>(s.out.path.size / 2)];
  s.box(at[0], at[1], at[0], at[1]);
  for (int i = 0; i < config.aborts - 1; ++i) out_of_time(s, task, token);
  job();
  EXPECT_NE(s.out.flags & PlanningTask::kReplanned, 0U);
  EXPECT_EQ(s.out.flags & PlanningTask::kGivenUp, 0U);
  // Blocked again, and never time for it: path and goal go.
  const auto next = s.out.path.points[static_cast<std::size_t>(s.out.path.size / 2)];
  s.box(next[0], next[1], next[0], next[1]);
  for (int i = 0; i < config.aborts; ++i) out_of_time(s, task, token);
  job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningNoTime);
  EXPECT_EQ(s.out.path.seq, 0U);
}

// A job that is aborted although it had nothing to plan says nothing about a goal.
TEST(PlanningTask, OnlyAbortedPlansCount) {
  Story s;
  PlanningConfig config;
  config.aborts = 1;
  PlanningTask task(startup.token(), config, 1);
  for (int i = 0; i < 5; ++i) {
    ++s.tick.k;
    (void)task.step(s.tick, s.in, s.out);
    task.abandon();
  }
  s.mark({1, 1, 0});
  ++s.tick.k;
  s.health = task.step(s.tick, s.in, s.out);
  EXPECT_NE(s.out.path.seq, 0U);
}

TEST(PlanningTask, SpendsItsAttemptsThenGivesUp) {
  Story s;
  PlanningConfig config;
  config.planner.iterations = 10;
  config.planner.guide_share = 0;
  config.planner.grid_fallback = false;
  PlanningTask task(startup.token(), config, 1);
  for (int i = 0; i < 8; ++i) {
    const double x = -1.5 + 0.5 * i;
    s.box(x, i % 2 ? -3 : -2.8, x, i % 2 ? 2.8 : 3);
  }
  s.mark({2.8, 2, 0});
  for (int i = 0; i < 3; ++i) {
    EXPECT_NE(s.out.state.phase, Phase::kFailed);
    ++s.tick.k;
    s.health = task.step(s.tick, s.in, s.out);
    EXPECT_EQ(s.out.status, PlanStatus::kBudgetSpent);
    s.in.event_count = 0;
  }
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
}

}  // namespace
}  // namespace tests
