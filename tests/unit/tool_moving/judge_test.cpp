// The judge of things that move is judged: its truth against brute force, and planted faults are
// found.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "perception/motion/motion_mask.hpp"
#include "tests/unit/tool_moving/place.hpp"

namespace teletact {
namespace {

using moving_test::sliding_box;
using moving_test::startup;
using perception::Pose;
using perception::Vec3;

constexpr auto kPlace = static_cast<std::uint8_t>(perception::PixelOf::kPlace);
constexpr auto kMoves = static_cast<std::uint8_t>(perception::PixelOf::kMoving);

PixelTruth truth_at(const MovingFilm& film, int frame, std::size_t pixel) {
  return static_cast<PixelTruth>(film.truth[static_cast<std::size_t>(frame)][pixel] & kTruthMask);
}

// What a ray through the pixel's middle says, by closed form: the box goes 10 mm a frame from frame
// 10 to 39.
PixelTruth brute(const drivers::World& world, const MovingSample& s, int frame, double u,
                 double v) {
  const auto k = s.camera();
  const Pose X_WC = s.way.X_WC(0);
  const auto hit = world.ray_cast(X_WC.translation(), X_WC.linear() * k.unproject(u, v, 1),
                                  MovingSample::time_of(frame));
  if (!hit || world.shapes()[static_cast<std::size_t>(hit.shape)].name != "box") {
    return PixelTruth::kStill;
  }
  const Vec3 p = X_WC * k.unproject(u, v, hit.t);
  if (frame < 10 || frame >= 39 + 40) return PixelTruth::kStill;
  if (frame >= 39 + 20) return PixelTruth::kEither;
  if (p.z() < 0.8 + 0.03) return PixelTruth::kEither;
  return std::min(frame, 39) - 9 >= 5 ? PixelTruth::kMoving : PixelTruth::kEither;
}

TEST(MovingJudge, TheTruthOfAPixelIsWhatBruteForceSays) {
  const MovingSample s = sliding_box();
  const MovingFilm film = film_moving(startup.token(), s, false);
  const drivers::World world(startup.token(), s.world, MovingSample::kBegin);
  ASSERT_EQ(film.with.size(), s.frames);
  const auto k = s.camera();
  int moving = 0, other = 0, checked = 0;
  for (const int f : {0, 9, 10, 13, 15, 30, 39, 58, 59, 78, 79, 89}) {
    for (int v = 0; v < k.height; v += 3) {
      for (int u = 0; u < k.width; u += 3) {
        const auto i = static_cast<std::size_t>(v * k.width + u);
        if (film.with.depth_mm(f, u, v) == 0) {
          EXPECT_EQ(truth_at(film, f, i), PixelTruth::kEither);
          continue;
        }
        // Rays are shifted by up to 4.1 sigma: beside an outline either side may be right.
        const PixelTruth t = brute(world, s, f, u, v);
        bool border = false;
        for (const double du : {-1.3, 1.3}) {
          for (const double dv : {-1.3, 1.3}) border |= brute(world, s, f, u + du, v + dv) != t;
        }
        if (border) continue;
        ++checked;
        other += truth_at(film, f, i) != t ? 1 : 0;
        moving += t == PixelTruth::kMoving ? 1 : 0;
      }
    }
  }
  EXPECT_EQ(other, 0) << "of " << checked;
  EXPECT_GT(moving, 1000);
  EXPECT_GT(checked, 50000);
}

TEST(MovingJudge, ADoorsInnerThirdIsNeitherAndItsEndMovesFirst) {
  MovingSample s = sliding_box();
  s.kind = MoverKind::kDoor;
  s.hinge_W = {1.2, 0.4, 0}, s.door_width_m = 0.4;  // the box's far edge, as if it hung there
  auto& m = s.world.movers[0];
  m.point_m = {1.2, 0.4, 0};
  for (auto& w : m.waypoints) w.offset_m = {0, 0, 0};
  m.waypoints[1].turn_deg = 60;  // 2 degrees a frame
  const drivers::World world(startup.token(), s.world, MovingSample::kBegin);
  const MoverTruth truth(world, s);
  const int box = world.find("box");
  const auto at = [&](int frame, double from_hinge) {
    const Vec3 rest(1.2, 0.4 - from_hinge, 1.0);
    const double a = 2 * std::clamp(frame - 9, 0, 30) * std::numbers::pi / 180;
    const Vec3 r = Eigen::AngleAxisd(a, Vec3::UnitZ()) * (rest - s.hinge_W);
    return truth.of(s.hinge_W + r, 1.0, box, frame);
  };
  EXPECT_EQ(at(39, 0.10), PixelTruth::kEither);
  EXPECT_EQ(at(39, 0.15), PixelTruth::kMoving);
  // 50 mm: at 0.38 m after 7.5 degrees, at 0.15 m after 19.2.
  EXPECT_EQ(at(12, 0.38), PixelTruth::kEither);
  EXPECT_EQ(at(13, 0.38), PixelTruth::kMoving);
  EXPECT_EQ(at(18, 0.15), PixelTruth::kEither);
  EXPECT_EQ(at(19, 0.15), PixelTruth::kMoving);
}

TEST(MovingJudge, TheShareIsThatOfTheReadings) {
  const MovingSample s = sliding_box(12);
  const MovingFilm film = film_moving(startup.token(), s, false);
  for (const int f : {0, 11}) {
    int valid = 0, mover = 0;
    const auto k = s.camera();
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        if (film.with.depth_mm(f, u, v) == 0) continue;
        ++valid;
        const auto i = static_cast<std::size_t>(v * k.width + u);
        mover += (film.truth[static_cast<std::size_t>(f)][i] & kMoverBit) != 0 ? 1 : 0;
      }
    }
    EXPECT_DOUBLE_EQ(film.share[static_cast<std::size_t>(f)], static_cast<double>(mover) / valid);
  }
  // The face, 0.4 m square at 1.05 m, less what drops out at its edges; and the side that the
  // camera sees of it (0.2 m aside: none). Its outline in px over all pixels; the far room has
  // readings nearly everywhere.
  const double face_px = 0.4 / 1.05 * 182.5;
  EXPECT_NEAR(film.share[0], face_px * face_px / (256 * 212), 0.006);
  EXPECT_NEAR(film.share_most, *std::max_element(film.share.begin(), film.share.end()), 0);
}

TEST(MovingJudge, APlantedMaskIsMeasured) {
  const MovingSample s = sliding_box(45);
  const MovingFilm film = film_moving(startup.token(), s, false);
  const auto& truth = film.truth[39];
  std::vector<std::uint8_t> exact(truth.size()), all(truth.size(), kMoves),
      none(truth.size(), kPlace);
  int moving = 0, still = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const PixelTruth t = truth_at(film, 39, i);
    moving += t == PixelTruth::kMoving ? 1 : 0;
    still += t == PixelTruth::kStill ? 1 : 0;
    exact[i] = t == PixelTruth::kStill ? kPlace : kMoves;  // what is either may be masked
  }
  EXPECT_DOUBLE_EQ(judge_mask(exact, truth).iou, 1);
  EXPECT_EQ(judge_mask(exact, truth).still_masked, 0);
  EXPECT_DOUBLE_EQ(judge_mask(none, truth).iou, 0);
  EXPECT_DOUBLE_EQ(judge_mask(all, truth).iou, static_cast<double>(moving) / (moving + still));
  EXPECT_DOUBLE_EQ(judge_mask(all, truth).still_masked, 1);
  // A hundred pixels too many.
  int more = 0;
  for (std::size_t i = 0; i < truth.size() && more < 100; ++i) {
    if (truth_at(film, 39, i) == PixelTruth::kStill) exact[i] = kMoves, ++more;
  }
  EXPECT_DOUBLE_EQ(judge_mask(exact, truth).iou, static_cast<double>(moving) / (moving + 100));
  EXPECT_DOUBLE_EQ(judge_mask(exact, truth).still_masked, 100.0 / still);
  // Nothing moves there: nothing to be judged but the still ones.
  EXPECT_TRUE(std::isnan(judge_mask(none, film.truth[0]).iou));
}

TEST(MovingJudge, APlantedWrongPoseIsCounted) {
  const Pose X_WT = [] {
    Pose X = Pose::Identity();
    X.linear() = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()).toRotationMatrix();
    X.translation() = Vec3(1, -2, 0.5);
    return X;
  }();
  const auto judged = [&](double share_most, double off_m) {
    PoseJudge judge(share_most);
    for (int f = 0; f < 20; ++f) {
      Pose truth = Pose::Identity();
      truth.translation() = Vec3(0.01 * f, 0, 0);
      Pose said = truth;
      if (f == 7 || f == 8) said.translation().y() += off_m;
      judge.add(f, f != 8, X_WT.inverse() * said, truth, share_most);
    }
    MovingRun run;
    judge.write(run);
    return run;
  };
  // Frame 8 is as far off as frame 7, and not claimed.
  EXPECT_EQ(judged(0.2, 0.021).wrong, 1);
  EXPECT_EQ(judged(0.2, 0.021).first_wrong, 7);
  EXPECT_EQ(judged(0.2, 0.019).wrong, 0);
  EXPECT_EQ(judged(0.4, 0.049).wrong, 0);
  EXPECT_EQ(judged(0.4, 0.051).wrong, 1);
  EXPECT_EQ(judged(0.2, std::nan("")).wrong, 1);
  EXPECT_NEAR(judged(0.2, 0.030).worst_mm, 30, 1e-9);
  EXPECT_NEAR(judged(0.2, 0.030).ate_mm, 30 / std::sqrt(19.0), 1e-9);
  EXPECT_DOUBLE_EQ(judged(0.2, 0).claimed, 0.95);
}

TEST(MovingJudge, TheWaitForAClaimIsCountedFromTheShareOn) {
  PoseJudge judge(0.5);
  //                 falls at 3: claims again at 6, so 3 frames; above again at 8, falls at 9, claims at once.
  const double share[] = {0.5, 0.5, 0.4, 0.2, 0.2, 0.2, 0.2, 0.2, 0.35, 0.1, 0.1};
  const bool claims[] = {true, false, false, false, false, false, true, true, true, true, true};
  for (int f = 0; f < 11; ++f)
    judge.add(f, claims[f], Pose::Identity(), Pose::Identity(), share[f]);
  MovingRun run;
  judge.write(run);
  EXPECT_EQ(run.claimed_again, 3);
  PoseJudge low(0.2);
  low.add(0, false, Pose::Identity(), Pose::Identity(), 0.2);
  low.write(run = {});
  EXPECT_TRUE(std::isnan(run.claimed_again));
}

class Ghosts : public ::testing::Test {
 protected:
  MovingSample sample = sliding_box();
  MovingFilm film = film_moving(startup.token(), sample, false);
  MovingGhosts ghosts{startup.token(), sample, film};
  // Vertices in the middles of cells of 10 mm over y x z = 0.1 x 0.2 m at x, from y on.
  static perception::Mesh sheet(double x, double y) {
    perception::Mesh mesh;
    for (int i = 0; i < 10; ++i) {
      for (int j = 0; j < 20; ++j) {
        mesh.vertices_W.emplace_back(static_cast<float>(x + 0.005),
                                     static_cast<float>(y + 0.01 * i + 0.005),
                                     static_cast<float>(0.9 + 0.01 * j + 0.005));
      }
    }
    mesh.vertices_W.insert(mesh.vertices_W.end(), mesh.vertices_W.begin(), mesh.vertices_W.end());
    return mesh;
  }
  double count(double x, double y, int frame) {
    return ghosts.volume_cm3(sheet(x, y), Pose::Identity(), frame);
  }
};

// The box was at y -0.0 .. 0.4, and is at -0.3 .. 0.1 from frame 39 on.
TEST_F(Ghosts, APlantedOneIsCountedWhereItWasSeenFree) {
  EXPECT_EQ(count(1.05, 0.2, 89), 200);  // where its face was
  EXPECT_EQ(count(1.15, 0.2, 89), 200);  // inside of where it was
  EXPECT_EQ(count(1.05, -0.2, 89), 0);   // its face as it is
  EXPECT_EQ(count(1.05, 0.6, 89), 0);    // it was never there
  EXPECT_EQ(count(0.90, 0.2, 89), 0);    // nor there, 150 mm before it
  EXPECT_EQ(count(1.05, 0.2, 9), 0);     // not then: it is there
  // Of y 0.2 .. 0.3 grown by 50 mm: free of it from frame 26 (0.3 m) to 36 (0.2 m) on, and ten
  // frames more.
  EXPECT_EQ(count(1.05, 0.2, 30), 0);
  EXPECT_GE(count(1.05, 0.2, 50), 190);  // but for a reading that dropped out
}

TEST_F(Ghosts, AMapThatIsAskewIsJudgedInTheWorld) {
  Pose X_WT = Pose::Identity();
  X_WT.linear() = Eigen::AngleAxisd(0.4, Vec3::UnitZ()).toRotationMatrix();
  X_WT.translation() = Vec3(0.3, -0.1, 0.02);
  perception::Mesh mesh = sheet(1.05, 0.2);
  for (auto& v : mesh.vertices_W) {
    v = (X_WT.inverse(Eigen::Isometry) * v.cast<double>()).cast<float>();
  }
  EXPECT_EQ(ghosts.volume_cm3(mesh, X_WT, 89), 200);
}

TEST_F(Ghosts, WhatTheCameraCanNotSeeIsNot) {
  // Behind the box as it is now: it hides its own former far side at y -0.0 .. 0.1.
  EXPECT_EQ(count(1.42, 0.0, 89), 0);
  EXPECT_EQ(count(1.35, 0.28, 89), 200);
}

TEST_F(Ghosts, AFrameThatIsNotClaimedSeesNothingFree) {
  for (int f = 0; f < 85; ++f) ghosts.claimed(f, false);
  EXPECT_EQ(count(1.05, 0.2, 89), 0);
  for (int f = 60; f < 85; ++f) ghosts.claimed(f, true);
  EXPECT_EQ(count(1.05, 0.2, 89), 200);
}

TEST_F(Ghosts, ACellOfTheCostMapIsCounted) {
  perception::CostMap map;
  map.ground_found = true;
  map.width = map.height = 80;
  map.X_WM.translation() = Vec3(0, -2, 0);
  map.cost.fill(perception::CostMap::kFree);
  const auto occupy = [&](double x, double y) {
    const int ix = static_cast<int>(x / 0.05), iy = static_cast<int>((y + 2) / 0.05);
    map.cost[map.index(ix, iy)] = perception::CostMap::kOccupied;
  };
  EXPECT_EQ(ghosts.cost_cells(map, Pose::Identity(), 89), 0);
  occupy(1.21, -0.11);  // the box, now
  occupy(2.71, 0.91);   // the shelf
  EXPECT_EQ(ghosts.cost_cells(map, Pose::Identity(), 89), 0);
  occupy(1.21, 0.31);  // where it was
  occupy(1.11, 0.26);
  EXPECT_EQ(ghosts.cost_cells(map, Pose::Identity(), 89), 2);
  EXPECT_EQ(ghosts.cost_cells(map, Pose::Identity(), 9), 0);
}

// A map of the first images, which hold the box where it was; and one of the last.
TEST_F(Ghosts, ANodeOfAHandsWindowIsCounted) {
  tasks::FusionConfig config;
  config.tsdf.voxel_size_m = 0.02;
  const auto nodes = [&](int first, int frame) {
    perception::TsdfMap map(startup.token(), config.tsdf);
    auto image = std::make_unique<perception::RgbdFrame>();
    for (int f = first; f < first + 4; ++f) {
      film.with.frame(f, *image);
      map.integrate(perception::FrameView::of(*image), *film.with.truth(f), 2);
    }
    return ghosts.window_nodes(map, Pose::Identity(), frame);
  };
  const int kept = nodes(0, 89);
  std::printf("  %d nodes\n", kept);
  EXPECT_GT(kept, 100) << "its first place";
  EXPECT_EQ(nodes(0, 9), 0) << "it is there";
  EXPECT_EQ(nodes(86, 89), 0) << "where it is now";
}

TEST_F(Ghosts, WhatRestsIsLookedForInMeshAndCostMap) {
  // Its face as it is, every 10 mm; and half of it.
  perception::Mesh face, half;
  for (int i = 0; i < 40; ++i) {
    for (int j = 0; j < 40; ++j) {
      const Eigen::Vector3f v(1.05F, -0.295F + 0.01F * static_cast<float>(i),
                              0.805F + 0.01F * static_cast<float>(j));
      face.vertices_W.push_back(v);
      if (i < 20) half.vertices_W.push_back(v);
    }
  }
  EXPECT_GT(ghosts.mover_in_mesh(face, Pose::Identity(), 80, 0.02), 0.99);
  EXPECT_NEAR(ghosts.mover_in_mesh(half, Pose::Identity(), 80, 0.02), 0.53, 0.06);
  EXPECT_EQ(ghosts.mover_in_mesh({}, Pose::Identity(), 80, 0.02), 0);
  perception::CostMap map;
  map.ground_found = true, map.width = map.height = 80;
  map.X_WM.translation() = Vec3(0, -2, 0);
  map.cost.fill(perception::CostMap::kFree);
  EXPECT_EQ(ghosts.mover_in_cost(map, Pose::Identity(), 80), 0);
  map.cost.fill(perception::CostMap::kOccupied);
  EXPECT_EQ(ghosts.mover_in_cost(map, Pose::Identity(), 80), 1);
}

std::uint64_t digest(const MovingFilm& film) {
  std::uint64_t h = 1;
  const auto k = film.with.intrinsics;
  for (int f = 0; f < film.with.size(); f += 20) {
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const auto i = static_cast<std::size_t>(v * k.width + u);
        h = rt::mix64(h, film.with.depth_mm(f, u, v) + 65536U * film.plain.depth_mm(f, u, v));
        h = rt::mix64(h, film.truth[static_cast<std::size_t>(f)][i]);
      }
    }
  }
  return h;
}

TEST(MovingSamples, TheSameSeedGivesTheSameBytes) {
  std::vector<std::uint64_t> digests;
  for (const std::uint64_t seed : {5U, 5U, 6U}) {
    MovingSample s = draw_moving_sample(startup.token(), seed, 2);
    s.half_images = true;
    digests.push_back(digest(film_moving(startup.token(), s, false)));
  }
  EXPECT_EQ(digests[0], digests[1]);
  EXPECT_NE(digests[0], digests[2]);
}

// What is drawn is as it is said to be, by other means than the drawing's.
TEST(MovingSamples, AreAsTheyAreSaidToBe) {
  std::set<MoverKind> kinds;
  int low = 0, all = 0, from_rest = 0, at_rest = 0;
  for (int i = 0; i < 24; ++i) {
    const MovingSample s = draw_moving_sample(startup.token(), 77, i);
    SCOPED_TRACE(s.text());
    const drivers::World world(startup.token(), s.world, MovingSample::kBegin);
    const drivers::World plain(startup.token(), s.plain, MovingSample::kBegin);
    EXPECT_FALSE(plain.moves());
    EXPECT_EQ(plain.shapes().size() + s.movers.size(), world.shapes().size());
    EXPECT_LE(s.size_m, 2.0);
    EXPECT_GE(s.distance_m, 0.5);
    EXPECT_LE(s.distance_m, 3.0);
    const bool angular = s.kind == MoverKind::kDoor || s.kind == MoverKind::kArm;
    EXPECT_GE(s.step, angular ? 0.5 : 2.0);
    EXPECT_LE(s.step, angular ? 5.0 : 100.0);
    double most = 0;
    for (int f = 0; f < s.frames; ++f) most = std::max(most, mover_share(world, s, f, 4));
    EXPECT_NEAR(most, s.share, 0.02 * s.share + 0.003);
    EXPECT_GE(s.share, 0.02);
    EXPECT_LE(s.share, 0.60);
    // The first mover's way a frame, in the middle of the first leg; the camera's speed.
    const int m = world.find(s.movers[0]);
    const int f = s.first_moving;
    const Pose a = world.X_WS_at(m, MovingSample::time_of(f - 1));
    const Pose b = world.X_WS_at(m, MovingSample::time_of(f));
    const double way = angular ? perception::rotation_angle(a.linear().transpose() * b.linear()) *
                                     180 / std::numbers::pi
                               : 1e3 * (b.translation() - a.translation()).norm();
    EXPECT_NEAR(way, s.step, 1e-3 * s.step);
    EXPECT_EQ(f, s.from_rest ? 60 : 1);
    for (int g = 1; g < s.frames; ++g) {
      const Pose step = s.way.X_WC((g - 1) * MovingSample::kFrame_s).inverse() *
                        s.way.X_WC(g * MovingSample::kFrame_s);
      EXPECT_LE(step.translation().norm() / MovingSample::kFrame_s, 0.25);
      EXPECT_LE(perception::rotation_angle(step.linear()) / MovingSample::kFrame_s,
                15.0 * std::numbers::pi / 180);
    }
    for (int g = 0; g < s.frames; g += 15) EXPECT_TRUE(rest_constrains(world, s, g));
    kinds.insert(s.kind);
    ++all, low += s.low() ? 1 : 0, from_rest += s.from_rest ? 1 : 0;
    at_rest += s.carry == Carry::kAtRest ? 1 : 0;
  }
  EXPECT_EQ(kinds.size(), static_cast<std::size_t>(kMoverKinds));
  EXPECT_EQ(low, all / 2);
  EXPECT_GT(from_rest, 6);
  EXPECT_LT(from_rest, 20);
  EXPECT_GT(at_rest, 3);
  EXPECT_LT(at_rest, 16);
}

}  // namespace
}  // namespace teletact
