// The fusion task on rendered frames: what it publishes, what it refuses, what it survives.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "perception/tsdf/patch/patch_copy.hpp"
#include "rt/hash.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::coarse;
using tests::kDt;
using tests::Rig;

TEST(FusionTask, TracksARoomAcrossLevelSwitches) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  double worst_mm = 0;
  for (int i = 0; i < 24; ++i) {
    rig.see(room, Rig::eye(i), 0.001, i < 8 ? 0 : (i < 16 ? 1 : 0));
    EXPECT_EQ(rig.health, rt::Health::ok()) << i;
    EXPECT_TRUE(rig.out.camera_written && rig.out.camera.claimed && rig.out.integrated) << i;
    worst_mm = std::max(
        worst_mm, 1000 * (rig.out.camera.X_WC.translation() - Rig::eye(i).translation()).norm());
  }
  std::cout << "worst error " << worst_mm << " mm over 24 frames, 215 mm\n";
  EXPECT_LT(worst_mm, 4.0);
  EXPECT_EQ(rig.task->frames_claimed(), 24U);
}

TEST(FusionTask, PatchEveryPeriodFollowsTheHand) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  for (int i = 0; i < 3; ++i) rig.see(room, Rig::eye(0));
  rig.in.hand.seq = 1;
  rig.in.hand.p_WH = Vec3(1.5, 0.5, 0.3);  // at the front of the large box
  rig.in.hand.v_WH = Vec3(0.3, 0, 0);
  rig.step(false);
  EXPECT_TRUE(rig.out.patch_written);
  EXPECT_FALSE(rig.out.camera_written);
  EXPECT_EQ(rig.patch->seq, 4U);
  EXPECT_EQ(rig.patch->nodes, 32);
  EXPECT_EQ(rig.patch->fused, rt::Time{rt::nanos_from_seconds(3 * kDt)});
  EXPECT_EQ(rig.patch->exposure, rig.frame->exposure);
  const Vec3 middle = rig.patch->node_W(16, 16, 16);
  const Vec3 wanted = rig.in.hand.p_WH + 2 * kDt * rig.in.hand.v_WH;
  EXPECT_LE((middle - wanted).cwiseAbs().maxCoeff(), 2 * 0.02 + 1e-3);  // period rounded to ns
  int observed = 0, inside = 0;
  for (std::size_t i = 0; i < rig.patch->cells(); ++i) {
    observed += rig.patch->material[i] != 0 ? 1 : 0;
    inside += rig.patch->material[i] != 0 && rig.patch->distance[i] <= 0 ? 1 : 0;
  }
  EXPECT_GT(observed, 500);
  EXPECT_GT(inside, 50);
  const auto checksum = rig.patch->checksum;
  rig.in.hand.p_WH = Vec3(std::numeric_limits<double>::quiet_NaN(), 0, 0);
  rig.step(false);
  EXPECT_TRUE(rig.out.patch_written)
      << "a hand that is not a number leaves the window where it was";
  EXPECT_EQ(rig.patch->seq, 5U);
  EXPECT_EQ(rig.patch->checksum, checksum);
}

// Within reach of the hand the patch is smoothed, elsewhere and with the key at 0 it is the map's
// own field.
TEST(FusionTask, ThePatchIsSmoothedRoundTheHandAlone) {
  const AnalyticScene room = tests::test_room();
  FusionConfig raw_config = coarse();
  raw_config.patch_smooth = 0;
  Rig raw(raw_config, Rig::eye(11), tests::kinect2_camera()),
      smooth(coarse(), Rig::eye(11), tests::kinect2_camera());
  // The middle of a face: what is seen 7 degrees beside it has its normal.
  const Pose X_WC = Rig::eye(0);
  const Vec3 way = X_WC.linear() * Vec3::UnitZ();
  const auto seen = [&](double x, double y) {
    return room.cast(X_WC.translation(), X_WC.linear() * Vec3(x, y, 1));
  };
  Vec3 hand = Vec3::Zero();
  for (double y = -0.25; y < 0.3 && hand.isZero(); y += 0.05)
    for (double x = -0.3; x < 0.35 && hand.isZero(); x += 0.05) {
      bool face = true;
      for (const double side : {-0.12, 0.12})
        face = face && seen(x + side, y).normal_W.dot(seen(x, y).normal_W) > 0.99 &&
               seen(x, y + side).normal_W.dot(seen(x, y).normal_W) > 0.99;
      const double facing = -seen(x, y).normal_W.dot(X_WC.linear() * Vec3(x, y, 1).normalized());
      if (face && facing > 0.5 && seen(x, y).t < 3)
        hand = X_WC.translation() + seen(x, y).t * (X_WC.linear() * Vec3(x, y, 1));
    }
  ASSERT_FALSE(hand.isZero());
  for (Rig* rig : {&raw, &smooth}) {
    for (int i = 11; i >= 0; --i) rig->see(room, Rig::eye(i), 0.002);
    rig->in.hand.seq = 1;
    rig->in.hand.p_WH = hand;
    rig->step(false);
    ASSERT_TRUE(rig->out.patch_written);
  }
  ASSERT_EQ(raw.patch->origin_node, smooth.patch->origin_node);
  int changed = 0, judged = 0;
  double before = 0, after = 0;
  for (int x = 0; x < 32; ++x)
    for (int y = 0; y < 32; ++y)
      for (int z = 0; z < 32; ++z) {
        const std::size_t at = raw.patch->index(x, y, z);
        const auto& o = raw.patch->origin_node;
        const auto word = raw.task->map().word_at(o[0] + x, o[1] + y, o[2] + z);
        if (raw.patch->material[at] != 0) {
          EXPECT_EQ(raw.patch->distance[at], perception::TsdfMap::word_distance(word));
        }
        const Vec3 p_W = raw.patch->node_W(x, y, z);
        const int was = raw.patch->distance[at], now = smooth.patch->distance[at];
        if (was == now) continue;
        ++changed;
        EXPECT_LT((p_W - hand).norm(), 4.5 * 0.02 + 1e-9);
        // Along the ray of the node's pixel, as the map measures; nodes of the face itself.
        const Vec3 ray = p_W - X_WC.translation();
        const double depth = way.dot(ray),
                     truth = (room.cast(X_WC.translation(), ray / depth).t - depth);
        if (std::abs(truth) > 0.02 || (p_W - hand).norm() > 2.9 * 0.02) continue;
        const double unit = static_cast<double>(raw.patch->metres_per_unit);
        ++judged;
        before += (unit * was - truth) * (unit * was - truth);
        after += (unit * now - truth) * (unit * now - truth);
      }
  std::cout << changed << " nodes; RMS near the hand " << 1e3 * std::sqrt(before / judged) << " -> "
            << 1e3 * std::sqrt(after / judged) << " mm\n";
  EXPECT_GT(judged, 20);
  EXPECT_GT(changed, 60);
  EXPECT_LT(after, 0.5 * before);
}

TEST(FusionTask, LostFrameIsNotIntegratedAndTrackingComesBack) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  for (int i = 0; i < 5; ++i) rig.see(room, Rig::eye(i));
  const auto before = rig.task->map().checksum();
  AnalyticScene other;
  other.planes = {{Vec3(1.0, 0, 0.5), Vec3(-1, 0.9, 0.7).normalized()}};
  for (int i = 5; i < 8; ++i) {
    rig.see(other, Rig::eye(i));
    EXPECT_FALSE(rig.out.camera.claimed);
    EXPECT_FALSE(rig.out.integrated);
    EXPECT_EQ(rig.health.fault, kFaultFusionLost);
    EXPECT_TRUE(rig.out.patch_written);
    EXPECT_EQ(rig.task->map().checksum(), before);
  }
  for (int i = 8; i < 11; ++i) rig.see(room, Rig::eye(i));
  EXPECT_TRUE(rig.out.camera.claimed);
  EXPECT_LT((rig.out.camera.X_WC.translation() - Rig::eye(10).translation()).norm(), 0.004);
  // Nobody looked for what moves in the image by which it was found: that one is not learned
  // either.
  EXPECT_FALSE(rig.out.integrated);
  EXPECT_EQ(rig.task->map().checksum(), before);
  rig.see(room, Rig::eye(11));
  EXPECT_TRUE(rig.out.integrated);
  EXPECT_NE(rig.task->map().checksum(), before);
}

TEST(FusionTask, BadFramesAreCountedNotFused) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  rig.step(false);  // no frame yet: patch and map are published, nothing is known
  EXPECT_TRUE(rig.out.patch_written && rig.out.cost_map_written);
  EXPECT_FALSE(rig.cost->ground_found);
  rig.see(AnalyticScene{}, Rig::eye(0));  // empty image
  EXPECT_EQ(rig.health.fault, kFaultFusionBadFrame);
  EXPECT_FALSE(rig.out.camera_written);
  rig.see(room, Rig::eye(0));
  EXPECT_TRUE(rig.out.camera.claimed);
  const auto before = rig.task->map().checksum();
  rig.step(true);  // the same frame again
  EXPECT_EQ(rig.health.fault, kFaultFusionBadFrame);
  rig.frame->intrinsics.fx *= 1.1;
  rig.frame->exposure += std::chrono::milliseconds(33);
  rig.step(true);  // another camera
  EXPECT_EQ(rig.health.fault, kFaultFusionBadFrame);
  rig.see(AnalyticScene{}, Rig::eye(0));  // black image while running
  EXPECT_EQ(rig.health.fault, kFaultFusionLost);
  EXPECT_EQ(rig.task->map().checksum(), before);
  rig.see(room, Rig::eye(0));
  EXPECT_TRUE(rig.out.camera.claimed);
}

AnalyticScene wall() {
  AnalyticScene s;
  s.planes = {{Vec3(1.2, 0, 0), -Vec3::UnitX()}};
  return s;
}
Pose along_wall(double y) { return tests::look_at(Vec3(0, y, 0.5), Vec3(1.2, y, 0.5)); }

TEST(FusionTask, OdometryCarriesAlongAWallUntilItsErrorIsTooLarge) {
  Rig rig(coarse(), along_wall(0));
  double claimed_until = -1;
  for (int i = 0; i < 50; ++i) {
    const double y = 0.02 * i;
    OdometryPrior o;
    o.taken = rt::Time{rt::nanos_from_seconds(i * kDt - 0.02)};
    o.X_OB = along_wall(y);  // mount = identity
    rig.in.odometry = o;
    rig.see(wall(), along_wall(y));
    if (rig.out.camera.claimed) {
      EXPECT_EQ(claimed_until, i == 0 ? -1 : 0.02 * (i - 1))
          << "no claim after the budget is spent";
      claimed_until = y;
      EXPECT_LT((rig.out.camera.X_WC.translation() - along_wall(y).translation()).norm(), 0.003);
    } else {
      EXPECT_EQ(rig.health.fault, kFaultFusionUnclaimed);
      EXPECT_FALSE(rig.out.integrated);
    }
  }
  // 2 % of 0.5 m is 10 mm.
  EXPECT_NEAR(claimed_until, 0.5, 0.03);
}

TEST(FusionTask, WithoutOdometryAWallIsNotClaimedAndStandsStill) {
  Rig rig(coarse(), along_wall(0));
  for (int i = 0; i < 20; ++i) {
    rig.see(wall(), along_wall(0), 0.0015);
    if (i > 0) {
      EXPECT_FALSE(rig.out.camera.claimed);
      EXPECT_EQ(rig.out.tracking.degenerate_count, 3);
    }
  }
  EXPECT_LT((rig.out.camera.X_WC.translation() - along_wall(0).translation()).norm(), 0.002);
}

// A force waits for the patch; what only a person sees, and the next image's ray cast, come behind
// it.
TEST(FusionTask, WhatOthersWaitForIsThereBeforeTheRest) {
  const AnalyticScene room = tests::test_room();
  Rig whole, parts;
  parts.in_parts = true;
  int views = 0;
  for (int i = 0; i < 12; ++i) {
    for (Rig* rig : {&whole, &parts}) rig->see(room, Rig::eye(i));
    EXPECT_TRUE(parts.first.patch && parts.first.camera) << i;
    EXPECT_EQ(parts.first.cost_map, whole.out.cost_map_written) << i;
    EXPECT_FALSE(parts.first.view) << i;
    views += parts.out.view_written ? 1 : 0;
    EXPECT_EQ(parts.patch->exposure, parts.frame->exposure) << "of this image";
    EXPECT_EQ(perception::patch_checksum(*parts.patch), perception::patch_checksum(*whole.patch));
    EXPECT_EQ(parts.out.work, whole.out.work);
    EXPECT_TRUE(parts.out.camera.X_WC.isApprox(whole.out.camera.X_WC, 0));
  }
  EXPECT_EQ(views, 4);
}

TEST(FusionTask, CostMapAndViewOfTheRoom) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  int views = 0, maps = 0;
  for (int i = 0; i < 12; ++i) {
    rig.see(room, Rig::eye(i));
    views += rig.out.view_written ? 1 : 0;
    maps += rig.out.cost_map_written ? 1 : 0;
  }
  EXPECT_EQ(views, 4);
  EXPECT_EQ(maps, 4);
  ASSERT_TRUE(rig.cost->ground_found);
  EXPECT_LT(std::abs(rig.task->ground().plane_W().offset), 0.01);
  const auto at = [&](double x, double y) {
    const Vec3 p = rig.cost->X_WM.inverse() * Vec3(x, y, 0) / rig.cost->resolution;
    return rig.cost->cost[rig.cost->index(static_cast<int>(p.x()), static_cast<int>(p.y()))];
  };
  EXPECT_EQ(at(1.7, 0.5), perception::CostMap::kOccupied) << "top of the box";
  EXPECT_EQ(at(1.5, -0.9), perception::CostMap::kOccupied);
  EXPECT_EQ(at(1.0, -0.2), perception::CostMap::kFree);
  EXPECT_EQ(at(0.0, 0.0), perception::CostMap::kFree);

  // The view shows the scene where it is: points lie on true surfaces.
  ASSERT_EQ(rig.view->seq, 4U);
  const auto& k = rig.view->intrinsics;
  ASSERT_EQ(k.width, 128);
  int seen = 0, off = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const auto& p = rig.view->points[static_cast<std::size_t>(v * k.width + u)];
      if (p.depth <= 0) continue;
      ++seen;
      const Vec3 d = rig.view->X_WV.linear() * k.unproject(u, v, 1);
      const tests::Hit hit = room.cast(rig.view->X_WV.translation(), d);
      const Vec3 q = rig.view->X_WV.translation() + hit.t * d;
      off += (q - Vec3(p.x, p.y, p.z)).norm() > 0.03 ? 1 : 0;
    }
  }
  EXPECT_GT(seen, k.width * k.height * 3 / 4);
  EXPECT_LT(off, seen / 20);
  perception::VirtualObstacle disc;
  disc.centre_W = Vec3(1.0, -0.2, 0);
  disc.radius_m = 0.15;
  rig.in.virtual_obstacles = {&disc, 1};
  rig.in.virtual_obstacles_changed = true;
  for (int i = 0; i < 3; ++i) rig.step(false);
  EXPECT_EQ(at(1.0, -0.2), perception::CostMap::kOccupied);
}

std::uint64_t run_hash(bool flip) {
  const AnalyticScene room = tests::test_room();
  Rig rig;
  rt::Hash64 hash;
  for (int i = 0; i < 6; ++i) {
    tests::fill_frame(room, rig.setup.camera, Rig::eye(i), 0.001, rig.random, *rig.frame);
    if (flip && i == 3) rig.frame->depth_mm[100 * 256 + 128] += 10;
    rig.frame->exposure = rt::Time{rt::nanos_from_seconds(i * kDt)};
    rig.step(true);
    hash.word(rig.patch->checksum);
    hash.bytes(rig.out.camera.X_WC.data(), 16 * sizeof(double));
    hash.bytes(rig.cost->cost.data(), rig.cost->cost.size());
    hash.bytes(rig.view->points.data(), sizeof rig.view->points);
    hash.word(rig.out.work);
  }
  return hash.digest();
}

TEST(FusionTask, SameInputSameBytesAndOnePixelShows) {
  const auto a = run_hash(false);
  EXPECT_EQ(a, run_hash(false));
  EXPECT_NE(a, run_hash(true));
}

TEST(FusionTask, FullMapIsReported) {
  FusionConfig config = coarse();
  config.tsdf.max_blocks = 64;
  Rig rig(config);
  rig.see(tests::test_room(), Rig::eye(0));
  EXPECT_EQ(rig.health.fault, kFaultFusionMapFull);
  EXPECT_TRUE(rig.out.patch_written);
}

TEST(FusionTask, RefusesAConfigurationThatCanNotWork) {
  rt::Startup startup;
  FusionSetup setup;
  setup.camera = tests::small_camera();
  FusionConfig c = coarse();
  c.patch_nodes = 30;
  EXPECT_THROW(FusionTask(startup.token(), c, setup), std::invalid_argument);
  c = coarse();
  setup.camera.width = 0;
  EXPECT_THROW(FusionTask(startup.token(), c, setup), std::invalid_argument);
  setup.camera = {585, 585, 320, 240, 640, 480};
  c.view_step = 1;
  EXPECT_THROW(FusionTask(startup.token(), c, setup), std::invalid_argument);
  c = coarse();
  setup.camera = tests::small_camera();
  c.patch_smooth = 1;
  EXPECT_THROW(FusionTask(startup.token(), c, setup), std::invalid_argument);
  c = coarse();
  c.levels[1].allocate_step = 3;
  EXPECT_THROW(FusionTask(startup.token(), c, setup), std::invalid_argument);
}

TEST(FusionConfig, EveryKeyCanBeSetAndIsChecked) {
  FusionConfig config;
  config::Section section;
  config.describe(section);
  const auto ok = config::load_text(
      "view_step = 4\n[tsdf]\nvoxel_size_m = 0.02\n[tracker]\ngate_distance_m = [0.04, 0.06, 0.1]\n"
      "[ground]\ncells = 128\n[[ground.virtual_obstacle]]\nshape = \"box\"\nposition_m = [1, 0, "
      "0]\n"
      "[level_1]\npixel_step = 4\n",
      "test", section);
  ASSERT_TRUE(ok) << ok.error();
  EXPECT_EQ(config.levels[1].pixel_step, 4);
  EXPECT_EQ(config.tracker.gate_distance_m[1], 0.06);
  ASSERT_EQ(config.ground.virtual_obstacles.size(), 1U);
  EXPECT_EQ(config.ground.virtual_obstacles[0].shape, "box");
  FusionConfig other;
  config::Section again;
  other.describe(again);
  EXPECT_FALSE(config::load_text("[ground]\ncells = 300\n", "test", again));
}

}  // namespace
}  // namespace tasks
