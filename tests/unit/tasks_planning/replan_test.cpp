// A goal while the world changes: the map closes the way, the marked object moves, the path has
// pieces.
#include <algorithm>
#include <cstdio>
#include <vector>

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

// Least distance of a place to the points of a path, in W.
double off(const Path& p, double x, double y) {
  double least = 1e9;
  for (int i = 0; i < p.size; ++i) {
    const auto& q = p.points[static_cast<std::size_t>(i)];
    least = std::min(least, std::hypot(q[0] - x, q[1] - y));
  }
  return least;
}

// What the robot drives while the news is on its way, and while it brakes, is the old path.
TEST(PlanningTask, ANewPathTurnsOffWhereTheRobotStillCan) {
  for (const double speed : {0.0, 0.2, 0.5}) {
    for (const double age_s : {0.04, 0.2}) {
      Story s;
      s.mark({2, 2, 0}).job();
      const Path first = s.out.path;
      const auto& here = first.points[10];
      s.robot.x_m = here[0];
      s.robot.y_m = here[1];
      s.robot.yaw_rad = 0.3;
      const double along = std::atan2(first.points[11][1] - here[1], first.points[11][0] - here[0]);
      s.robot.vx = speed * std::cos(along - 0.3);
      s.robot.vy = speed * std::sin(along - 0.3);
      s.robot.taken = s.tick.start + std::chrono::milliseconds(100) - rt::nanos_from_seconds(age_s);
      s.box(0.3, 0.3, 0.9, 0.9);
      s.job();
      ASSERT_TRUE(s.out.flags & PlanningTask::kReplanned);
      s.expect_path_sound();
      const Path& p = s.out.path;
      EXPECT_NEAR(p.points[0][0], here[0], 1e-9);
      EXPECT_NEAR(p.points[0][1], here[1], 1e-9);
      // 0.2 s for the jobs between, there and back, then 0.6 m/s^2.
      const double kept = speed * (2 * age_s + 0.2) + speed * speed / 1.2;
      double gone = 0;
      for (int i = 1; i < p.size; ++i) {
        const auto& q = p.points[static_cast<std::size_t>(i)];
        const auto& o = p.points[static_cast<std::size_t>(i - 1)];
        gone += std::hypot(q[0] - o[0], q[1] - o[1]);
        // The old path's points are 40 mm apart.
        if (gone > kept + 1e-9) break;
        EXPECT_LT(off(first, q[0], q[1]), 0.021) << speed << " " << gone;
      }
    }
  }
}

// A no-go area drawn beside the robot, a real wall on its other side: the way out of the one comes
// no nearer to the other than the body's radius.
TEST(PlanningTask, TheWayOutOfANoGoAreaIsNotThroughAnotherObstacle) {
  constexpr std::uint64_t kSeed = 4711;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  int escapes = 0;
  for (int n = 0; n < 60; ++n) {
    Story s;
    // Occupied blocks about the robot at the origin, inscribed cells about them by brute force.
    s.robot.x_m = s.robot.y_m = 0;
    std::vector<std::array<double, 2>> occupied;
    for (int b = 0; b < 2; ++b) {
      const double a = random.uniform(0, 6.28), d = random.uniform(0.1, 0.6);
      const double x = d * std::cos(a), y = d * std::sin(a), h = random.uniform(0.03, 0.15);
      s.box(x - h, y - h, x + h, y + h);
    }
    const auto at = [](int i) { return -3 + (i + 0.5) * 0.05; };
    for (int i = 0; i < 120 * 120; ++i) {
      if (s.map->cost[static_cast<std::size_t>(i)] == CostMap::kOccupied)
        occupied.push_back({at(i % 120), at(i / 120)});
    }
    for (int i = 0; i < 120 * 120; ++i) {
      auto& c = s.map->cost[static_cast<std::size_t>(i)];
      for (const auto& o : occupied) {
        if (c == CostMap::kFree && std::hypot(o[0] - at(i % 120), o[1] - at(i / 120)) <= 0.375)
          c = CostMap::kInscribed;
      }
    }
    s.mark({2, 2, 0}).job();
    if (s.out.path.size == 0) continue;  // no way out, and it says so
    if ((s.out.flags & PlanningTask::kEscape) == 0U) continue;
    ++escapes;
    for (const auto& o : occupied) {
      const double now = std::hypot(o[0], o[1]);
      const double allowed = std::min(0.375, now - 0.025) - 1e-9;
      for (int i = 1; i < s.out.path.size; ++i) {
        const auto& q = s.out.path.points[static_cast<std::size_t>(i)];
        ASSERT_GE(std::hypot(o[0] - q[0], o[1] - q[1]), allowed) << "map " << n;
      }
    }
  }
  std::printf("  %d of 60 had to get out\n", escapes);
  EXPECT_GT(escapes, 10);
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
