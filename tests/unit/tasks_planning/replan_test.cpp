// A goal while the world changes: the map closes the way, the marked object moves, the path has pieces.
#include <algorithm>

#include "tests/unit/tasks_planning/story.hpp"

namespace tests {
namespace {

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

}  // namespace
}  // namespace tests
