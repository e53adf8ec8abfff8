// What moves, on the ground's grid: a box whose pixels the test itself says to move, against where
// it truly is.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "perception/ground/ground_map.hpp"
#include "perception/motion/motion_mask.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

constexpr double kDt = 1.0 / 30;
const Pose kEye = tests::look_at(Vec3(-0.2, 0, 0.95), Vec3(1.6, 0, 0.1));

rt::Time seconds(double s) { return rt::Time{rt::nanos_from_seconds(s)}; }

struct Rig {
  rt::Startup startup;
  Intrinsics k = tests::small_camera();
  GroundPrior prior;
  std::unique_ptr<GroundMap> map;
  std::unique_ptr<CostMap> cost = std::make_unique<CostMap>();
  std::vector<float> all, still;
  std::vector<std::uint8_t> what;
  rt::Random random{7};
  double now_s = 0;

  explicit Rig(const GroundConfig& config = {}, const GroundPrior& p = {}) : prior(p) {
    prior.up_known = true;
    map = std::make_unique<GroundMap>(startup.token(), config, prior);
  }
  static tests::AnalyticScene place() {
    tests::AnalyticScene s;
    s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()}, {Vec3(3.5, 0, 0), -Vec3::UnitX()}};
    return s;
  }
  // Half a metre wide, 1.6 m tall, at (x, y).
  static tests::AnalyticScene thing_at(double x, double y, double half = 0.2) {
    auto s = place();
    Pose X = Pose::Identity();
    X.translation() = Vec3(x, y, 0.8);
    s.boxes.push_back({X, Vec3(half, half, 0.8)});
    return s;
  }
  // The next frame. `moves`: pixels that show the scene's box are masked, as fusion does.
  void see(const tests::AnalyticScene& scene, bool moves, const Pose& X_WC = kEye,
           bool claimed = true) {
    now_s += kDt;
    const auto z = tests::cast_depth(scene, k, X_WC), empty = tests::cast_depth(place(), k, X_WC);
    all.assign(z.size(), 0.0F);
    what.assign(z.size(), 0);
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (z[i] > 0) all[i] = static_cast<float>(z[i] + 0.002 * z[i] * random.normal());
      if (moves && z[i] > 0 && z[i] != empty[i])
        what[i] = static_cast<std::uint8_t>(PixelOf::kMoving);
    }
    still = all;
    bool any = false;
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (what[i] == 0) continue;
      still[i] = 0;
      any = true;
    }
    rt_guard::reset();
    {
      rt::Section section;
      if (claimed) map->update({k, {still.data(), k.width, k.height, k.width}, X_WC});
      if (any || map->moving() > 0)
        map->see_moving({k,
                         {all.data(), k.width, k.height, k.width},
                         {what.data(), k.width, k.height, k.width},
                         X_WC,
                         seconds(now_s),
                         any,
                         claimed});
      map->write(*cost, seconds(now_s + 0.02));
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  void look_about(int frames = 15) {
    for (int i = 0; i < frames; ++i) see(place(), false);
    ASSERT_TRUE(map->found());
    ASSERT_EQ(cost->moving_count, 0);
  }
  [[nodiscard]] int cell_at(double x_W, double y_W) const {
    const Vec3 p = cost->X_WM.inverse() * Vec3(x_W, y_W, 0) / cost->resolution;
    return static_cast<int>(
        cost->index(static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y()))));
  }
  [[nodiscard]] int at(double x_W, double y_W) const {
    return cost->cost[static_cast<std::size_t>(cell_at(x_W, y_W))];
  }
  [[nodiscard]] Vec3 centre_W(int cell) const {
    return cost->X_WM * Vec3((cell % cost->width + 0.5) * cost->resolution,
                             (cell / cost->width + 0.5) * cost->resolution, 0);
  }
  // Occupied cells nearer to the wall than that are the wall's.
  [[nodiscard]] int occupied() const {
    int n = 0;
    for (int c = 0; c < cost->width * cost->height; ++c)
      n += cost->cost[static_cast<std::size_t>(c)] == CostMap::kOccupied && centre_W(c).x() < 3.2;
    return n;
  }
  [[nodiscard]] int age_ms(double x_W, double y_W) const {
    const int cell = cell_at(x_W, y_W);
    for (int i = 0; i < cost->moving_count; ++i)
      if (cost->moving[static_cast<std::size_t>(i)].cell == cell)
        return cost->moving[static_cast<std::size_t>(i)].age_ms;
    return -1;
  }
};

TEST(MovingCells, OneImageIsEnough) {
  Rig rig;
  rig.look_about();
  ASSERT_EQ(rig.occupied(), 0);
  rig.see(Rig::thing_at(1.6, 0.1), true);
  EXPECT_EQ(rig.at(1.42, 0.1), CostMap::kOccupied) << "its front";
  EXPECT_EQ(rig.at(1.65, 0.1), CostMap::kInscribed) << "behind that nobody saw an obstacle";
  EXPECT_EQ(rig.at(2.0, 0.1), CostMap::kInscribed) << "and it is kept clear of as of one";
  EXPECT_EQ(rig.at(1.15, 0.1), CostMap::kInscribed) << "and the base does not fit before it";
  EXPECT_EQ(rig.at(1.42, -0.85), CostMap::kFree);
  EXPECT_EQ(rig.age_ms(1.42, 0.1), 20) << "from the exposure to the map";
  EXPECT_GE(rig.cost->moving_count, 40);
  // The same box without a mask gathers evidence as ever.
  Rig stands;
  stands.look_about();
  stands.see(Rig::thing_at(1.6, 0.1), false);
  EXPECT_EQ(stands.occupied(), 0);
  EXPECT_EQ(stands.cost->moving_count, 0);
}

// 40 mm a frame across the view. Every occupied cell is where the thing is, or hidden behind it.
TEST(MovingCells, GoesWithTheThingAndLeavesNoTrail) {
  Rig rig;
  rig.look_about();
  int frames = 0;
  double worst_m = 0;
  for (double y = -0.7; y <= 0.7; y += 0.04, ++frames) {
    rig.see(Rig::thing_at(1.7, y), true);
    if (frames < 1) continue;
    EXPECT_EQ(rig.at(1.52, y), CostMap::kOccupied) << y;
    for (int c = 0; c < rig.cost->width * rig.cost->height; ++c) {
      const Vec3 p = rig.centre_W(c);
      if (rig.cost->cost[static_cast<std::size_t>(c)] != CostMap::kOccupied || p.x() > 3.2)
        continue;
      // Off the thing's side, seen from the camera: by how much the line to the cell passes it by.
      const Vec3 d = p - kEye.translation();
      double lo = 9, hi = -9;
      for (const double dx : {-0.2, 0.2})
        for (const double dy : {-0.2, 0.2}) {
          const Vec3 corner = Vec3(1.7 + dx, y + dy, 0) - kEye.translation();
          lo = std::min(lo, std::atan2(corner.y(), corner.x()));
          hi = std::max(hi, std::atan2(corner.y(), corner.x()));
        }
      const double at = std::atan2(d.y(), d.x());
      worst_m = std::max(worst_m, d.head<2>().norm() * std::max(lo - at, at - hi));
      EXPECT_GT(p.x(), 1.4) << y;
      EXPECT_LT(p.x(), 1.9 + 0.3) << y;
    }
  }
  std::cout << frames << " frames, at most " << 1e3 * worst_m << " mm beside the thing\n";
  // Half a cell's diagonal, and the way of a frame that a cell on its rim may need to be seen free.
  EXPECT_LT(worst_m, 0.035 + 0.04);
}

TEST(MovingCells, IsGoneWhenItsPlaceIsSeenFree) {
  Rig rig;
  rig.look_about();
  for (int i = 0; i < 30; ++i) rig.see(Rig::thing_at(1.6, 0.1 + 0.01 * i), true);
  ASSERT_GT(rig.cost->moving_count, 40);
  int frames = 0;
  while (rig.occupied() > 0 && frames < 30) rig.see(Rig::place(), false), ++frames;
  std::cout << "gone after " << frames << " frames\n";
  EXPECT_LE(frames, 10);
  EXPECT_EQ(rig.map->moving(), 0);
  EXPECT_EQ(rig.at(1.42, 0.1), CostMap::kFree) << "what was seen free before is free again";
}

// The camera turns away: nothing says that the thing has gone, until nothing has said for long that
// it is there.
TEST(MovingCells, OutOfViewItStaysForTheStatedTime) {
  GroundConfig config;
  config.moving.hold_s = 1.5;
  Rig rig(config);
  rig.look_about();
  for (int i = 0; i < 5; ++i) rig.see(Rig::thing_at(1.6, 0.1), true);
  const int before = rig.occupied();
  const double seen_s = rig.now_s;
  const Pose away = tests::look_at(Vec3(-0.2, 0, 0.95), Vec3(-0.2, -1.8, 0.1));
  while (rig.now_s + 0.02 < seen_s + 1.5 - kDt) {
    rig.see(Rig::place(), false, away);
    ASSERT_EQ(rig.occupied(), before) << rig.now_s - seen_s;
    ASSERT_NEAR(rig.age_ms(1.42, 0.1), 1e3 * (rig.now_s + 0.02 - seen_s), 1.5);
  }
  EXPECT_GT(rig.age_ms(1.42, 0.1), 1300);
  for (int i = 0; i < 3; ++i) rig.see(Rig::place(), false, away);
  EXPECT_EQ(rig.occupied(), 0);
  EXPECT_EQ(rig.cost->moving_count, 0);
}

// Where no image comes at all the clock alone says it.
TEST(MovingCells, WithoutImagesItGoesByTheClock) {
  Rig rig;
  rig.look_about();
  rig.see(Rig::thing_at(1.6, 0.1), true);
  rig.map->write(*rig.cost, seconds(rig.now_s + 2.9));
  EXPECT_EQ(rig.at(1.42, 0.1), CostMap::kOccupied);
  EXPECT_EQ(rig.age_ms(1.42, 0.1), 2900);
  rig.map->write(*rig.cost, seconds(rig.now_s + 3.1));
  EXPECT_EQ(rig.occupied(), 0);
}

// What is hidden by a nearer thing that moves is not seen free.
TEST(MovingCells, WhatIsHiddenStays) {
  Rig rig;
  rig.look_about();
  for (int i = 0; i < 3; ++i) rig.see(Rig::thing_at(2.2, 0.0, 0.1), true);
  ASSERT_EQ(rig.at(2.12, 0.0), CostMap::kOccupied);
  for (int i = 0; i < 10; ++i) rig.see(Rig::thing_at(1.2, 0.0, 0.25), true);
  EXPECT_EQ(rig.at(2.12, 0.0), CostMap::kOccupied);
  EXPECT_GT(rig.age_ms(2.12, 0.0), 300);
  EXPECT_EQ(rig.at(0.97, 0.0), CostMap::kOccupied);
}

// It stands and is not masked any more: what stands takes over, with no image in between without an
// obstacle.
TEST(MovingCells, WhatComesToRestIsAnObstacleAllTheWay) {
  Rig rig;
  rig.look_about();
  for (int i = 0; i < 10; ++i) rig.see(Rig::thing_at(1.6, 0.1), true);
  for (int i = 0; i < 20; ++i) {
    rig.see(Rig::thing_at(1.6, 0.1), false);
    ASSERT_EQ(rig.at(1.42, 0.1), CostMap::kOccupied) << i;
  }
  EXPECT_EQ(rig.age_ms(1.42, 0.1), -1) << "it does not move";
}

// A frame whose pose is only guessed shows where somebody is; nothing is let go by it.
TEST(MovingCells, AnUnclaimedFrameShowsAndLetsNothingGo) {
  Rig rig;
  rig.look_about();
  rig.see(Rig::thing_at(1.6, 0.1), true, kEye, false);
  const int before = rig.cost->moving_count;
  EXPECT_GT(before, 40);
  rig.see(Rig::place(), false, kEye, false);
  EXPECT_EQ(rig.cost->moving_count, before);
  rig.see(Rig::place(), false);
  rig.see(Rig::place(), false);
  EXPECT_EQ(rig.occupied(), 0);
}

TEST(MovingCells, NeverUnderTheRobotItself) {
  GroundPrior prior;
  prior.body_B = {{Eigen::Vector2d(1.3, -0.5), Eigen::Vector2d(1.55, 0.5)}};
  prior.X_BC = kEye;  // the base's frame is the world's
  Rig rig(GroundConfig{}, prior);
  rig.look_about();
  for (int i = 0; i < 5; ++i) rig.see(Rig::thing_at(1.6, 0.1), true);
  EXPECT_NE(rig.at(1.42, 0.1), CostMap::kOccupied);
  EXPECT_EQ(rig.age_ms(1.42, 0.1), -1);
  GroundPrior elsewhere = prior;
  elsewhere.body_B = {{Eigen::Vector2d(-0.3, -0.2), Eigen::Vector2d(0.3, 0.2)}};
  Rig clear(GroundConfig{}, elsewhere);
  clear.look_about();
  clear.see(Rig::thing_at(1.6, 0.1), true);
  EXPECT_EQ(clear.at(1.42, 0.1), CostMap::kOccupied);
}

// Overhead things are driven under; a drawn-in area is no part of what moves.
TEST(MovingCells, KeepsToTheRobotsHeightAndLeavesDrawnAreasAlone) {
  Rig rig;
  rig.look_about();
  VirtualObstacle o;
  o.centre_W = Vec3(1.0, -0.5, 0);
  ASSERT_TRUE(rig.map->set_virtual({&o, 1}));
  rig.see(Rig::thing_at(1.6, 0.1), true);
  EXPECT_EQ(rig.at(1.0, -0.5), CostMap::kOccupied);
  EXPECT_EQ(rig.age_ms(1.0, -0.5), -1);
  ASSERT_TRUE(rig.map->set_virtual({}));
  rig.map->write(*rig.cost, seconds(rig.now_s));
  EXPECT_NE(rig.at(1.0, -0.5), CostMap::kOccupied);
  EXPECT_EQ(rig.at(1.42, 0.1), CostMap::kOccupied);
  ASSERT_TRUE(rig.map->set_virtual({&o, 1}));
  for (int i = 0; i < 3; ++i) rig.see(Rig::place(), false);
  EXPECT_EQ(rig.at(1.0, -0.5), CostMap::kOccupied);
  EXPECT_EQ(rig.map->moving(), 0);

  GroundConfig low;
  low.robot_height_m = 0.4;
  Rig under(low);
  under.look_about();
  auto lamp = Rig::place();
  Pose X = Pose::Identity();
  X.translation() = Vec3(1.6, 0, 0.65);
  lamp.boxes.push_back({X, Vec3(0.1, 0.1, 0.1)});
  under.see(lamp, true);
  EXPECT_EQ(under.map->moving(), 0);
}

TEST(MovingCells, SwitchedOffItIsNoObstacle) {
  GroundConfig config;
  config.moving.on = false;
  Rig rig(config);
  rig.look_about();
  for (int i = 0; i < 5; ++i) rig.see(Rig::thing_at(1.6, 0.1), true);
  EXPECT_EQ(rig.occupied(), 0);
}

// More than there is room for: what is nearest is kept, the rest is counted and nothing else is
// touched.
TEST(MovingCells, ACrowdFillsTheRoomThereIsFromTheNearestOn) {
  GroundConfig config;
  config.resolution_m = 0.02;
  Rig rig(config);
  rig.look_about();
  auto crowd = Rig::place();
  Pose X = Pose::Identity();
  X.translation() = Vec3(2.0, 0, 0.1);
  crowd.boxes.push_back({X, Vec3(1.0, 1.2, 0.1)});
  for (int i = 0; i < 3; ++i) rig.see(crowd, true);
  EXPECT_EQ(rig.map->moving(), CostMap::kMaxMoving);
  for (double y = -0.3; y < 0.3; y += 0.02)
    EXPECT_EQ(rig.at(1.01, y), CostMap::kOccupied) << "the front, " << y;
  for (int i = 0; i < 10; ++i) rig.see(Rig::place(), false);
  EXPECT_EQ(rig.map->moving(), 0);
  EXPECT_EQ(rig.occupied(), 0);
}

}  // namespace
}  // namespace perception
