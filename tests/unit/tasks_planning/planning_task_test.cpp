#include "tasks/planning/planning_task.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <numbers>

#include "tests/unit/tasks_planning/grid_oracle.hpp"

namespace {

using perception::CostMap;
using perception::Vec3;
using tasks::Mode;
using tasks::Path;
using tasks::PlanningConfig;
using tasks::PlanningTask;
using tasks::PlanStatus;
using tasks::Point2;
using tasks::TaskState;
using tasks::TouchEvent;
using Kind = TouchEvent::Kind;
using Phase = TaskState::Phase;

rt::Startup startup;

// A 6 m x 6 m room around the world's origin, the robot at (-2, -2).
struct Story {
  std::unique_ptr<CostMap> map = oracle::blank(120, 120);
  drivers::RobotState robot;
  PlanningTask task{startup.token(), PlanningConfig{}, 42};
  PlanningTask::In in;
  PlanningTask::Out out;
  rt::Tick tick;
  rt::Health health;
  std::uint64_t event_seq = 0;

  Story() {
    map->X_WM.translation() = Vec3(-3, -3, 0);
    robot.seq = 1;
    robot.x_m = robot.y_m = -2;
    in.map = map.get();
    in.robot = &robot;
  }
  Story& event(Kind kind, Vec3 p, Vec3 normal = {0, 0, 1}, bool gap = false) {
    auto& e = in.events[static_cast<std::size_t>(in.event_count++)];
    e = TouchEvent{};
    e.seq = ++event_seq;
    e.stamp = tick.start;
    e.kind = kind;
    e.p_W = p;
    e.normal_W = normal;
    e.gap = gap;
    return *this;
  }
  Story& mark(Vec3 p, Vec3 normal = {0, 0, 1}) {
    return event(Kind::kMarkBegin, p, normal)
        .event(Kind::kMarkPoint, p, normal)
        .event(Kind::kMarkEnd, p, normal);
  }
  Story& job() {
    ++tick.k;
    tick.start += std::chrono::milliseconds(100);
    health = task.step(tick, in, out);
    in.event_count = 0;
    return *this;
  }
  void box(double x0, double y0, double x1, double y1, std::uint8_t value = CostMap::kOccupied) {
    const auto cell = [](double v) { return static_cast<int>(std::floor((v + 3) / 0.05)); };
    oracle::fill(*map, cell(x0), cell(y0), cell(x1), cell(y1), value);
  }
  Point2 to_M(double x, double y) const {
    const Vec3 p = map->X_WM.inverse() * Vec3(x, y, 0);
    return {p.x(), p.y()};
  }
  void expect_path_sound() const {
    const Path& p = out.path;
    ASSERT_GT(p.size, 0);
    for (int i = 0; i < p.size; ++i) {
      const auto& q = p.points[static_cast<std::size_t>(i)];
      for (const double v : q) ASSERT_TRUE(std::isfinite(v));
      ASSERT_LE(std::abs(q[2]), std::numbers::pi + 1e-12);
      if (i == 0) continue;
      const auto& o = p.points[static_cast<std::size_t>(i - 1)];
      ASSERT_LE(std::hypot(q[0] - o[0], q[1] - o[1]), 0.05 + 1e-9);
      ASSERT_TRUE(oracle::free_segment(*map, to_M(o[0], o[1]), to_M(q[0], q[1])));
    }
  }
  const std::array<double, 3>& last() const {
    return out.path.points[static_cast<std::size_t>(out.path.size - 1)];
  }
};

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

TEST(PlanningTask, PlansAgainWhenTheMapClosesTheWay) {
  Story s;
  s.mark({2, 2, 0}).job();
  const Path first = s.out.path;
  s.job();
  EXPECT_EQ(s.out.path.seq, first.seq);
  s.box(-0.5, -0.5, 0.5, 0.5);
  s.job();
  EXPECT_TRUE(s.out.flags & PlanningTask::kReplanned);
  EXPECT_TRUE(s.out.flags & PlanningTask::kPathDropped);
  EXPECT_EQ(s.out.path.seq, 2U);
  EXPECT_EQ(s.out.path.mark_seq, first.mark_seq);
  s.expect_path_sound();
  // An obstacle on what has been driven already is of no interest.
  const auto mid = s.out.path.points[static_cast<std::size_t>(s.out.path.size / 2)];
  const auto early = s.out.path.points[10];
  s.robot.x_m = mid[0];
  s.robot.y_m = mid[1];
  s.box(early[0] - 0.05, early[1] - 0.05, early[0] + 0.05, early[1] + 0.05);
  s.job();
  EXPECT_EQ(s.out.path.seq, 2U);
  // Walled in: the path is withdrawn and the goal given up.
  s.box(1.4, 1.4, 2.9, 1.5);
  s.box(1.4, 1.4, 1.5, 2.9);
  s.box(1.4, 2.5, 2.9, 2.6);
  s.box(2.5, 1.4, 2.6, 2.9);
  s.box(1.5, 1.5, 2.5, 2.5, CostMap::kUnknown);
  s.job();
  EXPECT_EQ(s.out.path.seq == 0, s.out.state.phase == Phase::kFailed);
}

// The list that fusion publishes: one object of serial 7, and which mark it answered.
tasks::ObjectList objects_at(const Vec3& centre_W, std::uint64_t mark_seq, std::uint8_t touched) {
  tasks::ObjectList list;
  list.seq = 1;
  list.size = 2;
  list.entries[0].id = 1;
  list.entries[0].serial = 3;
  list.entries[0].summarised = true;
  list.entries[1].id = 2;
  list.entries[1].serial = 7;
  list.entries[1].summarised = true;
  list.entries[1].X_WO.translation() = centre_W - Vec3(0.1, 0, 0);
  list.entries[1].centre_m = Vec3(0.1, 0, 0);
  list.mark_seq = mark_seq;
  list.touched = touched;
  return list;
}

TEST(PlanningTask, AGoalGoesAfterTheObjectThatItsMarkNamed) {
  Story s;
  tasks::ObjectList list;  // never published
  s.in.objects = &list;
  s.mark({1, 1, 0}).job();
  ASSERT_EQ(s.out.path.seq, 1U);
  const std::uint64_t mark = s.out.path.mark_seq;
  list = objects_at({1, 1.1, 0.2}, mark, 2);
  s.job();
  EXPECT_EQ(s.out.path.seq, 1U) << "it is where the mark was";
  list = objects_at({1.1, 1.15, 0.2}, mark + 9, 0);  // a later mark on nothing; it wanders a little
  s.job();
  EXPECT_EQ(s.out.path.seq, 1U);
  list = objects_at({1.5, 1.1, 0.2}, mark + 9, 0);
  s.job();
  EXPECT_TRUE(s.out.flags & PlanningTask::kObjectMoved);
  EXPECT_EQ(s.out.path.seq, 2U);
  EXPECT_EQ(s.out.path.mark_seq, mark);
  s.expect_path_sound();
  EXPECT_NEAR(s.last()[0], 1.5, 1e-12);
  EXPECT_NEAR(s.last()[1], 1, 1e-12);
  // Gone from the list, or no numbers: the goal stays.
  list.size = 1;
  s.job();
  EXPECT_EQ(s.out.path.seq, 2U);
  list = objects_at(Vec3::Constant(std::nan("")), mark, 2);
  s.job();
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningBadInput);
  EXPECT_EQ(s.out.path.seq, 2U);
  // After the arrival nothing is followed.
  s.robot.x_m = s.last()[0];
  s.robot.y_m = s.last()[1];
  list = objects_at({1.5, 1.1, 0.2}, mark, 2);
  s.job();
  ASSERT_EQ(s.out.state.phase, Phase::kArrived);
  list = objects_at({-1, -1, 0.2}, mark, 2);
  s.job();
  EXPECT_EQ(s.out.path.seq, 2U);
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
}

TEST(PlanningTask, AMarkOnNoObjectStaysWhereItIs) {
  Story s;
  s.mark({1, 1, 0}).job();
  const std::uint64_t mark = s.out.path.mark_seq;
  auto list = objects_at({1, 1.1, 0.2}, mark, 0);  // refused
  s.in.objects = &list;
  s.job();
  list = objects_at({2, 2, 0.2}, mark, 0);
  s.job();
  EXPECT_EQ(s.out.path.seq, 1U);
  // An aborted job has not followed either.
  list = objects_at({2, 2, 0.2}, mark, 2);
  s.job();
  list = objects_at({-2, 2, 0.2}, mark, 2);
  s.job();
  EXPECT_EQ(s.out.path.seq, 2U);
  s.task.abandon();
  s.job();
  EXPECT_EQ(s.out.path.seq, 2U) << "the same plan, made again";
  EXPECT_TRUE(s.out.flags & PlanningTask::kObjectMoved);
}

TEST(PlanningTask, GivesUpWhatIsUnreachable) {
  Story s;
  s.box(0, -3, 0.05, 2.99, CostMap::kUnknown);
  s.mark({2.5, 0, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kFailed);
  EXPECT_EQ(s.out.state.failures, 1U);
  EXPECT_EQ(s.out.status, PlanStatus::kUnreachable);
  EXPECT_EQ(s.health.fault, tasks::kFaultPlanningNoPath);
  EXPECT_EQ(s.out.path.seq, 0U);
  s.job();
  EXPECT_EQ(s.out.state.failures, 1U) << "a new try needs a new mark";
  s.mark({-1, 1, 0}).job();
  EXPECT_EQ(s.out.state.phase, Phase::kDriving);
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

TEST(PlanningTask, ALongPathComesInPieces) {
  Story s;
  // Walls that make the way far longer than a Path holds.
  for (int i = 0; i < 9; ++i) {
    const double x = -1.7 + 0.5 * i;
    s.box(x, i % 2 ? -2.5 : -3, x + 0.04, i % 2 ? 3 : 2.5);
  }
  s.mark({2.8, 0, 0});
  int paths = 0;
  for (int i = 0; i < 4000 && s.out.state.phase != Phase::kArrived; ++i) {
    const auto before = s.out.path.seq;
    s.job();
    ASSERT_NE(s.out.state.phase, Phase::kFailed);
    paths += s.out.path.seq != before;
    if (s.out.path.seq != before) s.expect_path_sound();
    // Follow: the point after the nearest.
    int best = 0;
    double d = 1e9;
    for (int j = 0; j < s.out.path.size; ++j) {
      const auto& q = s.out.path.points[static_cast<std::size_t>(j)];
      const double e = std::hypot(q[0] - s.robot.x_m, q[1] - s.robot.y_m);
      if (e <= d) d = e, best = j;
    }
    const auto& q =
        s.out.path.points[static_cast<std::size_t>(std::min(best + 1, s.out.path.size - 1))];
    s.robot.x_m = q[0];
    s.robot.y_m = q[1];
  }
  EXPECT_EQ(s.out.state.phase, Phase::kArrived);
  EXPECT_GT(paths, 1);
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
