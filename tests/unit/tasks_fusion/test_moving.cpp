// Something walks through the view of the fusion task: what it publishes of it. Nobody tells the
// task what moves.
#include <gtest/gtest.h>

#include <cmath>

#include "perception/motion/motion_mask.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::coarse;
using tests::Rig;

constexpr double kHalf = 0.18, kX = 1.0;

AnalyticScene walker_at(double y) {
  AnalyticScene s = tests::test_room();
  Pose X = Pose::Identity();
  X.translation() = Vec3(kX, y, 0.55);
  s.boxes.push_back({X, Vec3(kHalf, kHalf, 0.55)});
  return s;
}

FusionConfig every_map() {
  FusionConfig c = coarse();
  c.cost_map_period = 1;
  c.view_period_frames = 1;
  return c;
}

// Cells that something moves in, by how far they are from the walker's box, m, seen from above; the
// farthest.
struct Told {
  int cells = 0, inside = 0, seen = 0;
  double farthest_m = 0;
};
Told told(const perception::CostMap& m, double y) {
  Told t;
  t.cells = m.moving_count;
  for (int i = 0; i < m.moving_count; ++i) {
    const int cell = m.moving[static_cast<std::size_t>(i)].cell;
    const auto cost = m.cost[static_cast<std::size_t>(cell)];
    t.seen += cost == perception::CostMap::kOccupied ? 1 : 0;  // the rest is behind that
    EXPECT_TRUE(cost == perception::CostMap::kOccupied || cost == perception::CostMap::kInscribed)
        << static_cast<int>(cost);
    const Vec3 p = m.X_WM * Vec3((cell % m.width + 0.5) * m.resolution,
                                 (cell / m.width + 0.5) * m.resolution, 0);
    const double dx = std::max(0.0, std::abs(p.x() - kX) - kHalf),
                 dy = std::max(0.0, std::abs(p.y() - y) - kHalf);
    t.farthest_m = std::max(t.farthest_m, std::hypot(dx, dy));
    t.inside += std::hypot(dx, dy) < 0.04 ? 1 : 0;
  }
  return t;
}

TEST(FusionMoving, AWalkerIsAnObstacleWithinTwoFramesAndLeavesNone) {
  Rig rig(every_map());
  for (int i = 0; i < 20; ++i) rig.see(tests::test_room(), Rig::eye(0));
  ASSERT_TRUE(rig.cost->ground_found);
  ASSERT_EQ(rig.cost->moving_count, 0);
  EXPECT_FALSE(rig.view->masked);
  // It comes in from the side, 40 mm a frame.
  int masked_at = -1, told_at = -1, frame = 0, late = 0;
  double farthest_m = 0;
  for (double y = -1.5; y < 1.2; y += 0.04, ++frame) {
    rig.see(walker_at(y), Rig::eye(0));
    if (masked_at < 0 && rig.out.motion.masked_share > 0.01) masked_at = frame;
    if (told_at < 0 && rig.cost->moving_count > 4) told_at = frame;
    if (std::abs(y) > 0.6) continue;
    ASSERT_TRUE(rig.out.camera.claimed) << y;
    const Told t = told(*rig.cost, y);
    late += t.inside < 20 || t.seen < 5 ? 1 : 0;
    farthest_m = std::max(farthest_m, t.farthest_m);
    ASSERT_TRUE(rig.view->masked) << y;
    EXPECT_GT(std::count(rig.view->what.begin(), rig.view->what.end(),
                         static_cast<std::uint8_t>(perception::PixelOf::kMoving)),
              200);
  }
  std::cout << "masked in frame " << masked_at << ", in the cost map in " << told_at
            << "; farthest cell " << 1e3 * farthest_m << " mm from it\n";
  ASSERT_GE(masked_at, 0);
  EXPECT_LE(told_at, masked_at + 2);
  EXPECT_EQ(late, 0) << "frames that did not have it where it is";
  // Behind it up to what it is taken to reach, and a cell.
  EXPECT_LT(farthest_m, 0.30 + 0.08);
  // It walks out on the left. Ten frames later nothing says that it was anywhere that is in view;
  // what is beside the image stays for the stated time.
  for (int i = 0; i < 10; ++i) rig.see(tests::test_room(), Rig::eye(0));
  const perception::CostMap& m = *rig.cost;
  for (int i = 0; i < m.width * m.height; ++i) {
    const Vec3 p =
        m.X_WM * Vec3((i % m.width + 0.5) * m.resolution, (i / m.width + 0.5) * m.resolution, 0);
    if (p.x() < 0.75 || p.x() > 1.25 || std::abs(p.y()) > 0.85) continue;
    EXPECT_NE(m.cost[static_cast<std::size_t>(i)], perception::CostMap::kOccupied) << p.transpose();
  }
  EXPECT_LE(m.moving_count, 4);
  for (int i = 0; i < 95; ++i) rig.see(tests::test_room(), Rig::eye(0));
  EXPECT_EQ(m.moving_count, 0);
  EXPECT_LT((rig.out.camera.X_WC.translation() - Rig::eye(0).translation()).norm(), 0.005);
}

TEST(FusionMoving, SwitchedOffItIsNone) {
  FusionConfig c = every_map();
  c.ground.moving.on = false;
  Rig rig(c);
  for (int i = 0; i < 20; ++i) rig.see(tests::test_room(), Rig::eye(0));
  for (double y = -1.5; y < 0; y += 0.04) rig.see(walker_at(y), Rig::eye(0));
  EXPECT_GT(rig.out.motion.masked_share, 0.01);
  EXPECT_EQ(rig.cost->moving_count, 0);
  EXPECT_TRUE(rig.view->masked);
}

// The first map with it does not wait for the map's own period.
TEST(FusionMoving, TheFirstSightIsPublishedAtOnce) {
  FusionConfig c = coarse();
  c.cost_map_period = 30;
  Rig rig(c);
  for (int i = 0; i < 40; ++i) rig.see(tests::test_room(), Rig::eye(0));
  bool was = false;
  for (double y = -1.5; y < 0; y += 0.04) {
    rig.see(walker_at(y), Rig::eye(0));
    const bool moving = rig.task->ground().moving() > 0;
    if (moving && !was) {
      EXPECT_TRUE(rig.out.cost_map_written);
      EXPECT_GT(rig.cost->moving_count, 0);
      EXPECT_LE(rig.cost->moving[0].age_ms, 50);
      return;
    }
    was = moving;
  }
  ADD_FAILURE() << "never seen to move";
}

// Somebody stands close to the robot until they belong to the map, and walks on. What stands still
// is mostly floor and wall, which agree with any motion along them: most of what tells one motion
// from another moves. Odometry that is trusted says which.
TEST(FusionMoving, WhoStoodCloseAndWalksOnDoesNotCarryACameraWithOdometry) {
  const Pose X_WC = tests::look_at(Vec3(0, 0, 0.9), Vec3(2, 0, 0.9));
  const auto room_with = [](double y) {
    AnalyticScene s;
    Pose wall = Pose::Identity();
    wall.translation() = Vec3(2.6, 0, 1);
    s.boxes.push_back({wall, Vec3(0.1, 4, 3)});
    Pose floor = Pose::Identity();
    floor.translation() = Vec3(1, 0, -0.1);
    s.boxes.push_back({floor, Vec3(4, 4, 0.1)});
    for (const double side : {-1.0, 1.0}) {
      Pose shelf = Pose::Identity();
      shelf.translation() = Vec3(2.0, 1.1 * side, 0.6);
      s.boxes.push_back({shelf, Vec3(0.25, 0.25, 0.6)});
    }
    Pose person = Pose::Identity();
    person.translation() = Vec3(0.85, y, 0.9);
    person.linear() = Eigen::AngleAxisd(0.5, Vec3::UnitZ()).toRotationMatrix();
    s.boxes.push_back({person, Vec3(0.22, 0.22, 0.9)});
    return s;
  };
  Rig rig(coarse(), X_WC);
  double worst_m = 0;
  int claimed = 0, frames = 0;
  for (int i = 0; i < 100; ++i) {
    const double y = -0.017 * std::max(0, i - 70);
    OdometryPrior standing;
    standing.taken =
        rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * tests::kDt - 0.02)};
    rig.in.odometry = standing;
    rig.see(room_with(y), X_WC);
    if (i <= 70) continue;
    ++frames;
    if (!rig.out.camera.claimed) continue;
    ++claimed;
    worst_m = std::max(worst_m, (rig.out.camera.X_WC.translation() - X_WC.translation()).norm());
  }
  std::printf("  %d of %d frames claimed, at most %.1f mm off\n", claimed, frames, 1e3 * worst_m);
  EXPECT_GE(claimed, frames * 95 / 100);
  EXPECT_LT(worst_m, 0.02);
}

}  // namespace
}  // namespace tasks
