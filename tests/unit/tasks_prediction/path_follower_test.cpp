#include "tasks/prediction/path_follower.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/tasks_prediction/paths.hpp"

namespace tests {
namespace {

using tasks::PathFollower;

TEST(PathFollower, ChoosesTheFurtherPointWhereTheWayIsStraight) {
  PathFollower f{{}};
  ASSERT_TRUE(f.take(make_path(1, {{0, 0, 0}, {2, 0, 0}})));
  const auto g = f.next({0.3, 0, 0});
  EXPECT_TRUE(g.is_mark);
  EXPECT_EQ(g.X_WG.x, 2);
  EXPECT_NEAR(g.progress_m, 0.3, 1e-9);
  EXPECT_NEAR(g.remaining_m, 1.7, 1e-9);
  // A bend on the way: the mark may not be driven at, the path point is.
  ASSERT_TRUE(f.take(make_path(2, {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}})));
  const auto b = f.next({0.3, 0, 0});
  EXPECT_FALSE(b.is_mark);
  EXPECT_NEAR(b.X_WG.x, 0.75, 1e-9);
  EXPECT_NEAR(b.X_WG.y, 0, 1e-9);
  // Near the corner the point is drawn nearer, but never below the minimum.
  const auto c = f.next({0.9, 0, 0});
  EXPECT_LT(c.ahead_m, 0.35);
  EXPECT_GE(c.ahead_m, 0.15 - 1e-9);
  // Beyond it the rest is straight.
  EXPECT_TRUE(f.next({1.0, 0.3, 0}).is_mark);
}

TEST(PathFollower, ProgressNeverGoesBackNorLeapsToALaterBranch) {
  PathFollower f{{}};
  // A hairpin: out along y = 0, back along y = 0.2.
  ASSERT_TRUE(f.take(make_path(1, {{0, 0, 0}, {3, 0, 0}, {3, 0.2, 0}, {0, 0.2, 0}})));
  EXPECT_NEAR(f.next({0.5, 0.15, 0}).progress_m, 0.5, 0.01);  // nearer to the way back
  EXPECT_NEAR(f.next({1.0, 0, 0}).progress_m, 1.0, 1e-9);
  EXPECT_NEAR(f.next({0.2, 0, 0}).progress_m, 1.0, 1e-9);
}

// The path was changed under way and the base is beside it: what lies between the way back and the
// path is cut by no more than the corridor, and the nearer the base comes, the further ahead it
// looks.
TEST(PathFollower, ABaseBesideThePathIsLedBackBeforeItGoesOn) {
  const tasks::PathFollowerConfig c;
  double before = 0;
  for (const double aside : {0.4, 0.3, 0.2, 0.1, 0.06, 0.04}) {
    PathFollower f{c};
    ASSERT_TRUE(f.take(make_path(1, {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}}, 0.04)));
    const auto g = f.next({0.6, aside, 0});
    EXPECT_NEAR(g.progress_m, 0.6, 1e-9);
    // Distance of the nearest point (0.6, 0) from the straight way to the goal.
    const double cut = aside * g.ahead_m / std::hypot(aside, g.ahead_m);
    EXPECT_LE(cut, c.corridor_m + 1e-9) << aside;
    EXPECT_GE(g.ahead_m, before) << aside;
    before = g.ahead_m;
  }
  EXPECT_NEAR(before, c.look_ahead_m, 1e-9) << "within the corridor nothing changes";
}

TEST(PathFollower, RefusesBadPathsAndHandlesTinyOnes) {
  PathFollower f{{}};
  Path p = make_path(1, {{0, 0, 0}, {1, 0, 0}});
  p.points[3][1] = std::nan("");
  EXPECT_FALSE(f.take(p));
  p = make_path(2, {{0, 0, 0}, {1, 0, 0}});
  p.size = 0;
  EXPECT_FALSE(f.take(p));
  p.size = Path::kMaxPoints + 1;
  EXPECT_FALSE(f.take(p));
  Path one;
  one.seq = 3;
  one.size = 1;
  one.points[0] = {1, 2, 0.5};
  ASSERT_TRUE(f.take(one));
  const auto g = f.next({0, 0, 0});
  EXPECT_EQ(g.X_WG, (Pose2{1, 2, 0.5}));
  EXPECT_EQ(g.remaining_m, 0);
  Path twice;  // equal points: segments of no length
  twice.seq = 4;
  twice.size = 4;
  for (int i = 0; i < 4; ++i) twice.points[static_cast<std::size_t>(i)] = {i < 2 ? 0.0 : 1.0, 0, 0};
  ASSERT_TRUE(f.take(twice));
  EXPECT_TRUE(perception::is_finite(f.next({0.1, 0.1, 0}).X_WG));
}

}  // namespace
}  // namespace tests
