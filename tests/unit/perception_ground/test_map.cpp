// Cost map of a rendered room, inflation against brute force, drawn-in obstacles, forgetting.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <numbers>

#include "perception/ground/ground_map.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

struct Rig {
  rt::Startup startup;
  Intrinsics k = tests::small_camera();
  GroundConfig config;
  GroundPrior prior;
  std::unique_ptr<GroundMap> map;
  std::unique_ptr<CostMap> cost = std::make_unique<CostMap>();
  std::vector<float> depth;

  explicit Rig(const GroundConfig& c = {}, bool up_known = true) : config(c) {
    prior.up_known = up_known;
    map = std::make_unique<GroundMap>(startup.token(), config, prior);
  }
  void see(const tests::AnalyticScene& scene, const Pose& X_WC, double sigma, rt::Random& random) {
    const auto z = tests::cast_depth(scene, k, X_WC);
    depth.assign(z.size(), 0.0F);
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (z[i] > 0) depth[i] = static_cast<float>(z[i] + sigma * z[i] * random.normal());
    }
    rt_guard::reset();
    {
      rt::Section section;
      map->update({k, {depth.data(), k.width, k.height, k.width}, X_WC});
      map->write(*cost);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  [[nodiscard]] int at(double x_W, double y_W) const {
    const Vec3 p = cost->X_WM.inverse() * Vec3(x_W, y_W, 0) / cost->resolution;
    const int ix = static_cast<int>(std::floor(p.x())), iy = static_cast<int>(std::floor(p.y()));
    return cost->contains(ix, iy) ? cost->cost[cost->index(ix, iy)] : -1;
  }
};

tests::AnalyticScene floor_with_box() {
  tests::AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()}, {Vec3(3.5, 0, 0), -Vec3::UnitX()}};
  Pose X = Pose::Identity();
  X.translation() = Vec3(1.8, 0.3, 0.15);
  s.boxes.push_back({X, Vec3(0.15, 0.15, 0.15)});
  return s;
}

TEST(GroundMap, BoxIsOccupiedFloorIsFreeBehindIsUnknown) {
  rt::Random random(1);
  Rig rig;
  for (int i = 0; i < 12; ++i) {
    const Pose X_WC = tests::look_at(Vec3(-0.2 + 0.01 * i, 0, 0.95), Vec3(1.6, 0, 0.1));
    rig.see(floor_with_box(), X_WC, 0.003, random);
  }
  ASSERT_TRUE(rig.map->found());
  ASSERT_TRUE(rig.cost->ground_found);
  EXPECT_EQ(rig.at(1.66, 0.3), CostMap::kOccupied) << "front face of the box";
  EXPECT_EQ(rig.at(1.8, 0.3), CostMap::kOccupied) << "its top";
  EXPECT_EQ(rig.at(1.8, -0.6), CostMap::kFree);
  EXPECT_EQ(rig.at(1.0, 0.0), CostMap::kFree);
  EXPECT_EQ(rig.at(0.0, 0.0), CostMap::kFree) << "start disc";
  EXPECT_EQ(rig.at(0.3, 0.3), CostMap::kFree) << "start disc, below the camera's view";
  EXPECT_EQ(rig.at(1.45, 0.3), CostMap::kInscribed) << "0.2 m before the box";
  const int near = rig.at(1.20, 0.3), far = rig.at(1.10, 0.3);
  EXPECT_GT(near, far);
  EXPECT_GT(far, 0);
  EXPECT_LT(near, CostMap::kInscribed);
  EXPECT_EQ(rig.at(3.48, 0.0), CostMap::kOccupied) << "wall";
  EXPECT_EQ(rig.at(-2.0, 0.0), CostMap::kUnknown) << "behind the robot";
  EXPECT_EQ(rig.at(2.45, 0.41), CostMap::kUnknown) << "in the shadow of the box";
  EXPECT_EQ(rig.at(1.0, 1.5), CostMap::kUnknown) << "outside the view";
  // Between the robot and the box every cell of the floor is known, also where pixel rows are far
  // apart.
  for (double x = 0.0; x < 2.9; x += 0.05) {
    EXPECT_NE(rig.at(x, -0.05 - 0.26 * x), CostMap::kUnknown) << x;
  }
}

TEST(GroundMap, SlantedCameraWithoutKnowingUp) {
  for (const double roll : {-20.0, 0.0, 15.0}) {
    rt::Random random(2);
    Rig rig({}, false);
    Pose X_WC = tests::look_at(Vec3(0, 0, 0.8), Vec3(1.4, 0, 0.0));
    X_WC.rotate(Eigen::AngleAxisd(roll * kDegree, Vec3::UnitZ()));
    for (int i = 0; i < 4; ++i) rig.see(floor_with_box(), X_WC, 0.003, random);
    ASSERT_TRUE(rig.map->found()) << roll;
    const double tilt = std::acos(std::min(1.0, rig.map->plane_W().normal.z())) / kDegree;
    std::cout << "roll " << roll << ": tilt " << tilt << " deg, height error "
              << 1000 * (rig.map->plane_W().height(Vec3(0, 0, 0.8)) - 0.8) << " mm\n";
    EXPECT_LT(tilt, 0.5);
    EXPECT_NEAR(rig.map->plane_W().height(Vec3(0, 0, 0.8)), 0.8, 0.01);
  }
}

TEST(GroundMap, TakenAwayBoxIsForgotten) {
  rt::Random random(3);
  Rig rig;
  const Pose X_WC = tests::look_at(Vec3(0, 0, 0.95), Vec3(1.6, 0, 0.1));
  for (int i = 0; i < 20; ++i) rig.see(floor_with_box(), X_WC, 0.002, random);
  ASSERT_EQ(rig.at(1.8, 0.3), CostMap::kOccupied);
  auto empty = floor_with_box();
  empty.boxes.clear();
  for (int i = 0; i < rig.config.evidence_cap; ++i) rig.see(empty, X_WC, 0.002, random);
  EXPECT_EQ(rig.at(1.8, 0.3), CostMap::kFree);
  EXPECT_EQ(rig.at(1.66, 0.3), CostMap::kFree);
}

TEST(GroundMap, OverheadIsFreeTrackingDriftIsFollowed) {
  rt::Random random(4);
  GroundConfig config;
  config.robot_height_m = 0.6;
  Rig rig(config);
  tests::AnalyticScene s = floor_with_box();
  s.boxes.clear();
  Pose board = Pose::Identity();
  board.translation() = Vec3(1.8, 0, 0.75);
  s.boxes.push_back({board, Vec3(0.3, 0.3, 0.01)});  // a board above the robot
  Pose X_WC = tests::look_at(Vec3(0, 0, 0.5), Vec3(1.6, 0, 0.2));
  for (int i = 0; i < 6; ++i) rig.see(s, X_WC, 0.002, random);
  EXPECT_EQ(rig.at(1.8, 0.0), CostMap::kFree);
  // The tracker's height creeps up by 1 mm a frame to 80 mm: the floor stays floor.
  for (int i = 0; i < 80; ++i) {
    rig.see(s, X_WC, 0.002, random);
    Pose drifted = X_WC;
    drifted.translation().z() += 0.001 * i;
    rig.map->update({rig.k, {rig.depth.data(), rig.k.width, rig.k.height, rig.k.width}, drifted});
  }
  rig.map->write(*rig.cost);
  EXPECT_EQ(rig.at(1.5, 0.0), CostMap::kFree);
}

TEST(GroundMap, InflationEqualsBruteForce) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    rt::Random random(seed);
    GroundConfig config;
    config.cells = 96;
    config.start_radius_m = 4;  // all cells known
    config.robot_radius_m = random.uniform(0.05, 0.6);
    config.inflation_m = random.uniform(0, 0.8);
    Rig rig(config);
    tests::AnalyticScene s = floor_with_box();
    s.boxes.clear();
    s.planes.resize(1);
    const Pose X_WC = tests::look_at(Vec3(0, 0, 0.95), Vec3(1.6, 0, 0.1));
    std::vector<VirtualObstacle> drawn;
    for (int i = 0; i < 12; ++i) {
      VirtualObstacle o;
      o.kind = i % 2 == 0 ? VirtualObstacle::Kind::kDisc : VirtualObstacle::Kind::kBox;
      o.centre_W = Vec3(random.uniform(-2.5, 2.5), random.uniform(-2.5, 2.5), 0);
      o.radius_m = random.uniform(0.01, 0.3);
      o.half_x_m = random.uniform(0.01, 0.4);
      o.half_y_m = random.uniform(0.01, 0.4);
      o.yaw_rad = random.uniform(-3, 3);
      drawn.push_back(o);
    }
    ASSERT_TRUE(rig.map->set_virtual(drawn));
    for (int i = 0; i < 4; ++i) rig.see(s, X_WC, 0.001, random);
    ASSERT_TRUE(rig.map->found());
    const CostMap& m = *rig.cost;
    std::vector<std::pair<int, int>> occupied;
    for (int y = 0; y < m.height; ++y) {
      for (int x = 0; x < m.width; ++x) {
        if (m.cost[m.index(x, y)] == CostMap::kOccupied) occupied.emplace_back(x, y);
      }
    }
    ASSERT_GT(occupied.size(), 20U);
    for (int y = 0; y < m.height; ++y) {
      for (int x = 0; x < m.width; ++x) {
        double d2 = 1e9;
        for (const auto& [ox, oy] : occupied) {
          d2 = std::min(d2, static_cast<double>((ox - x) * (ox - x) + (oy - y) * (oy - y)));
        }
        const double beyond = std::sqrt(d2) * m.resolution - config.robot_radius_m;
        int expected = 0;
        if (d2 == 0)
          expected = CostMap::kOccupied;
        else if (beyond <= m.resolution / 2)
          expected = CostMap::kInscribed;
        else if (beyond < config.inflation_m)
          expected = static_cast<int>(std::max(1.0, 252 * (1 - beyond / config.inflation_m)));
        ASSERT_EQ(m.cost[m.index(x, y)], expected) << "seed " << seed << " cell " << x << ' ' << y;
      }
    }
  }
}

TEST(GroundMap, NothingSeenIsAllUnknown) {
  rt::Random random(7);
  Rig rig;
  tests::AnalyticScene nothing;
  rig.see(nothing, Pose::Identity(), 0, random);
  EXPECT_FALSE(rig.cost->ground_found);
  for (std::size_t i = 0; i < 256U * 256U; ++i) {
    ASSERT_EQ(rig.cost->cost[i], CostMap::kUnknown);
    ASSERT_TRUE(std::isnan(rig.cost->height_m[i]));
  }
  Pose nan = Pose::Identity();
  nan.translation().x() = std::nan("");
  rig.see(floor_with_box(), nan, 0, random);
  EXPECT_FALSE(rig.map->found());
  std::vector<VirtualObstacle> many(GroundMap::kMaxVirtual + 1);
  EXPECT_FALSE(rig.map->set_virtual(many));
}

// A box that the robot can not see behind: cleared, its cells are unknown, and free only when their
// floor is seen.
TEST(GroundMap, AForgottenBoxIsUnknownUntilItsFloorIsSeen) {
  Rig rig;
  rt::Random random(11);
  const Pose X_WC = tests::look_at(Vec3(0, 0, 0.95), Vec3(1.6, 0, 0.1));
  const auto scene = floor_with_box();
  auto empty = scene;
  empty.boxes.clear();
  for (int i = 0; i < 20; ++i) rig.see(scene, X_WC, 0.001, random);
  ASSERT_TRUE(rig.map->found());
  ASSERT_EQ(rig.at(1.75, 0.3), CostMap::kOccupied);
  ASSERT_EQ(rig.at(1.0, -0.4), CostMap::kFree);
  const auto occupied = [&] {
    return std::count(rig.cost->cost.begin(), rig.cost->cost.end(),
                      static_cast<std::uint8_t>(CostMap::kOccupied));
  };
  const auto before = occupied();
  // A box in the air, one under the floor, one elsewhere and one that is none: nothing is
  // forgotten.
  using Box = Eigen::AlignedBox3d;
  rig.map->forget(Box(Vec3(1.5, 0, 1.5), Vec3(2.1, 0.6, 2)));
  rig.map->forget(Box(Vec3(1.5, 0, -2), Vec3(2.1, 0.6, -1)));
  rig.map->forget(Box(Vec3(-3, -3, 0), Vec3(-2, -2, 1)));
  rig.map->forget(Box());
  rig.map->forget(Box(Vec3(std::nan(""), 0, 0), Vec3(2, 1, 1)));
  rig.map->write(*rig.cost);
  EXPECT_EQ(occupied(), before);
  rig.map->forget(Box(Vec3(1.6, 0.1, 0), Vec3(2.0, 0.5, 0.3)));
  rig.map->write(*rig.cost);
  EXPECT_LT(occupied(), before);
  EXPECT_EQ(rig.at(1.75, 0.3), CostMap::kUnknown);
  EXPECT_EQ(rig.at(1.0, -0.4), CostMap::kFree) << "what was seen free elsewhere stays";
  rig.see(empty, X_WC, 0.001, random);
  EXPECT_EQ(rig.at(1.75, 0.3), CostMap::kFree) << "its floor was seen once";
  // The same box seen again is an obstacle again.
  rig.map->forget(Box(Vec3(1.6, 0.1, 0), Vec3(2.0, 0.5, 0.3)));
  for (int i = 0; i < 4; ++i) rig.see(scene, X_WC, 0.001, random);
  EXPECT_EQ(rig.at(1.75, 0.3), CostMap::kOccupied);
}

// What stood high before a camera that looks ahead, taken away: the floor below it is not in view.
struct Mast {
  tests::AnalyticScene with, without;
  Pose down = tests::look_at(Vec3(0, 0, 0.75), Vec3(1.6, 0, 0.1)),
       ahead = tests::look_at(Vec3(0, 0, 0.75), Vec3(2, 0, 0.75));
  Vec3 centre{0.8, 0, 0.75}, half{0.1, 0.2, 0.15};
  explicit Mast(bool wall = true) {
    without.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()}};
    if (wall) without.planes.push_back({Vec3(3.0, 0, 0), -Vec3::UnitX()});
    with = without;
    Pose X = Pose::Identity();
    X.translation() = centre;
    with.boxes.push_back({X, half});
  }
  [[nodiscard]] static int occupied(Rig& rig, const Eigen::AlignedBox2d& where) {
    int n = 0;
    for (double x = where.min().x() + 0.01; x < where.max().x(); x += 0.02)
      for (double y = where.min().y() + 0.01; y < where.max().y(); y += 0.02)
        n += rig.at(x, y) == CostMap::kOccupied ? 1 : 0;
    return n;
  }
  [[nodiscard]] Eigen::AlignedBox2d grown() const {
    return {(centre - half - Vec3::Constant(0.1)).head<2>(),
            (centre + half + Vec3::Constant(0.1)).head<2>()};
  }
};

TEST(GroundMap, WhatIsSeenThroughIsForgottenWithoutItsFloor) {
  rt::Random random(13);
  Rig rig;
  const Mast mast;
  for (int i = 0; i < 20; ++i) rig.see(mast.without, mast.down, 0.002, random);
  ASSERT_TRUE(rig.map->found());
  for (int i = 0; i < 60; ++i) rig.see(mast.with, mast.ahead, 0.002, random);
  EXPECT_GT(Mast::occupied(rig, mast.grown()), 20);
  for (int i = 0; i < 10; ++i) rig.see(mast.without, mast.ahead, 0.002, random);
  EXPECT_EQ(Mast::occupied(rig, mast.grown()), 0);
}

// No wall behind it: there is no reading, and it may be there still.
TEST(GroundMap, WithoutAReadingNothingIsSeenThrough) {
  rt::Random random(14);
  Rig rig;
  const Mast mast(false);
  for (int i = 0; i < 20; ++i) rig.see(mast.without, mast.down, 0.002, random);
  ASSERT_TRUE(rig.map->found());
  for (int i = 0; i < 60; ++i) rig.see(mast.with, mast.ahead, 0.002, random);
  const int before = Mast::occupied(rig, mast.grown());
  EXPECT_GT(before, 20);
  for (int i = 0; i < 60; ++i) rig.see(mast.without, mast.ahead, 0.002, random);
  EXPECT_EQ(Mast::occupied(rig, mast.grown()), before);
}

// What stood there has gone on behind its place, and is no part of what stands: its readings show
// the place free all the same. Without them it is as if there were none.
TEST(GroundMap, WhatMovesOnBehindAPlaceShowsItFree) {
  for (const bool all : {true, false}) {
    rt::Random random(16);
    Rig rig;
    const Mast mast(false);
    for (int i = 0; i < 20; ++i) rig.see(mast.without, mast.down, 0.002, random);
    for (int i = 0; i < 60; ++i) rig.see(mast.with, mast.ahead, 0.002, random);
    EXPECT_GT(Mast::occupied(rig, mast.grown()), 20);
    auto gone_on = mast.without;
    Pose X = Pose::Identity();
    X.translation() = Vec3(2.2, 0, 0.75);
    gone_on.boxes.push_back({X, Vec3(0.1, 1.5, 0.7)});
    const auto still = tests::cast_depth(mast.without, rig.k, mast.ahead),
               with = tests::cast_depth(gone_on, rig.k, mast.ahead);
    std::vector<float> place(still.size()), every(still.size());
    for (std::size_t i = 0; i < still.size(); ++i) {
      every[i] = static_cast<float>(with[i]);
      place[i] = with[i] == still[i] ? every[i] : 0.0F;
    }
    GroundFrame frame{rig.k, {place.data(), rig.k.width, rig.k.height, rig.k.width}, mast.ahead};
    if (all) {
      frame.all_intrinsics = rig.k;
      frame.all_m = {every.data(), rig.k.width, rig.k.height, rig.k.width};
    }
    for (int i = 0; i < 10; ++i) rig.map->update(frame);
    rig.map->write(*rig.cost);
    const int left = Mast::occupied(rig, mast.grown());
    if (all) {
      EXPECT_EQ(left, 0);
    } else {
      EXPECT_GT(left, 20);
    }
  }
}

// The oracle: from the camera straight to points of the mast's column, past a thing that hides some
// of it for good. A cell is free when all that was seen of the mast in it lies open, and stays when
// some of it is hidden.
TEST(GroundMap, WhatIsHiddenStays) {
  rt::Random random(15);
  Rig rig;
  Mast mast;
  for (int i = 0; i < 20; ++i) rig.see(mast.without, mast.down, 0.002, random);
  ASSERT_TRUE(rig.map->found());
  for (int i = 0; i < 60; ++i) rig.see(mast.with, mast.ahead, 0.002, random);
  Pose X = Pose::Identity();
  X.translation() = Vec3(0.45, 0.08, 0.72);
  const tests::AnalyticScene::Box hides{X, Vec3(0.02, 0.05, 0.04)};
  mast.without.boxes.push_back(hides);
  for (int i = 0; i < 60; ++i) rig.see(mast.without, mast.ahead, 0.002, random);
  const Vec3 eye = mast.ahead.translation();
  const double front = mast.centre.x() - mast.half.x();  // the face that was seen
  int open = 0, hidden = 0;
  for (int iy = 0; iy < rig.cost->height; ++iy) {
    const double y = rig.cost->X_WM.translation().y() + (iy + 0.5) * rig.cost->resolution;
    if (std::abs(y) > mast.half.y() - 0.03) continue;
    int met = 0, of = 0;
    bool near = false;  // too near to the shadow's edge to be told
    for (double z = mast.centre.z() - mast.half.z(); z <= mast.centre.z() + mast.half.z();
         z += 0.01) {
      const auto blocked = [&](double dy) {
        const Vec3 d = Vec3(front, y + dy, z) - eye;
        return mast.without.cast(eye, d).t < 1;
      };
      ++of;
      met += blocked(0) ? 1 : 0;
      near = near || blocked(-0.03) != blocked(0) || blocked(0.03) != blocked(0);
    }
    ASSERT_GT(of, 20);
    const int cost = rig.at(front + 0.01, y);
    if (near || (met > 0 && met < 4)) continue;
    (met > 0 ? hidden : open) += 1;
    if (met > 0) {
      EXPECT_EQ(cost, CostMap::kOccupied) << y << ", hidden " << met << " of " << of;
    } else {
      EXPECT_NE(cost, CostMap::kOccupied) << y;
    }
  }
  EXPECT_GE(open, 3);
  EXPECT_GE(hidden, 1);
}

}  // namespace
}  // namespace perception
