// A map of another day, and a map that is larger than its pool.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/unit/tasks_fusion/hall.hpp"

namespace tasks {
namespace {

using tests::add_box;
using tests::AnalyticScene;
using tests::coarse;
using tests::in_hall;
using tests::in_passage;
using tests::off_m;
using tests::Rig;

// A hall with things along its walls.
AnalyticScene hall() {
  AnalyticScene s = tests::empty_hall(2.6, 2);
  add_box(s, Vec3(2.0, 1.2, 0.35), Vec3(0.5, 0.4, 0.7), 0.4);
  add_box(s, Vec3(1.6, -0.9, 0.2), Vec3(0.3, 0.5, 0.4), 0.9);
  add_box(s, Vec3(0.3, 1.5, 0.5), Vec3(0.4, 0.3, 1.0), -0.3);
  add_box(s, Vec3(-1.6, 0.9, 0.25), Vec3(0.6, 0.3, 0.5), 0.2);
  add_box(s, Vec3(-1.9, -1.1, 0.4), Vec3(0.3, 0.3, 0.8), -0.5);
  add_box(s, Vec3(0.2, -1.4, 0.3), Vec3(0.5, 0.3, 0.6), 0.7);
  return s;
}

void tour(Rig& rig, const AnalyticScene& scene) { tests::tour(rig, scene, 72, 0); }

perception::MapFile stored(Rig& rig) {
  auto& nrt = rig.startup.token();
  auto file = perception::parse_map(
      nrt, perception::encode_map(nrt, rig.task->map(), rig.task->keyframes()), "hall.map");
  EXPECT_TRUE(file);
  return std::move(file).value();
}

TEST(StoredMap, TheCameraIsFoundInItWithin15FramesAndNowhereElse) {
  const AnalyticScene scene = hall();
  Rig before(coarse(), in_hall(0));
  tour(before, scene);
  const perception::MapFile file = stored(before);
  for (const double yaw : {0.1, 1.9, -2.2}) {
    Rig rig(coarse(), in_hall(0));
    ASSERT_TRUE(rig.task->load_map(rig.startup.token(), file));
    EXPECT_EQ(rig.task->map().block_count(), before.task->map().block_count());
    int took = 0;
    do {
      ++took;
      rig.see(scene, in_hall(yaw + 0.002 * took, 0.06), 0.0015);
    } while (!rig.out.camera.claimed && took < 15);
    ASSERT_TRUE(rig.out.camera.claimed) << "yaw " << yaw;
    EXPECT_GE(took, 2) << "two frames must agree";
    const double off = off_m(rig, in_hall(yaw + 0.002 * took, 0.06));
    std::printf("  yaw %.1f: found after %d frames, %.1f mm off\n", yaw, took, 1000 * off);
    EXPECT_LT(off, 0.02);
    // And from there on it is a map like any other.
    for (int i = 0; i < 10; ++i) {
      rig.see(scene, in_hall(yaw + 0.03 + 0.01 * i, 0.06), 0.0015);
      EXPECT_TRUE(rig.out.camera.claimed && rig.out.integrated);
    }
  }
  AnalyticScene elsewhere;
  elsewhere.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
                      {Vec3(1.2, 0, 0.5), Vec3(-1, 0.6, 0.2).normalized()}};
  Rig rig(coarse(), in_hall(0));
  ASSERT_TRUE(rig.task->load_map(rig.startup.token(), file));
  const auto content = rig.task->map().checksum();
  for (int i = 0; i < 15; ++i) {
    rig.see(elsewhere, in_hall(0.01 * i), 0.0015);
    EXPECT_FALSE(rig.out.camera.claimed);
    EXPECT_EQ(rig.health.fault, kFaultFusionLost);
  }
  EXPECT_EQ(rig.task->map().checksum(), content) << "nothing is fused into a map one is not in";
}

TEST(StoredMap, AWrongOneIsRefusedAndTheTaskIsAsNew) {
  const AnalyticScene scene = hall();
  Rig before(coarse(), in_hall(0));
  before.see(scene, in_hall(0), 0.0015);
  const perception::MapFile file = stored(before);
  FusionConfig finer = coarse();
  finer.tsdf.voxel_size_m = 0.01;
  Rig rig(finer, in_hall(0));
  const auto refused = rig.task->load_map(rig.startup.token(), file);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("voxels of 0.02"), std::string::npos) << refused.error();
  rig.see(scene, in_hall(0), 0.0015);
  EXPECT_TRUE(rig.out.camera.claimed) << "the first image defines the map";
}

// A way of 20 m and back through a passage, beside a map that keeps it all in its pool. What lies
// within 3 m of the camera, in chunks of 1.28 m, is less than half of it from anywhere.
TEST(StoredMap, FarBlocksComeAndGoAndTrackingDoesNotNotice) {
  constexpr int kFrames = 480;
  const AnalyticScene s = tests::passage(24);
  const auto way = [](int n) {
    return in_passage(10 * (1 - std::cos(2 * std::numbers::pi * n / (kFrames - 1))), n);
  };
  FusionConfig config = coarse();
  config.tsdf.max_depth_m = config.tracker.preprocess.depth_max_m = 2.0;
  config.tsdf.far_m = 3.0;
  config.tsdf.far_store_kib = 0;
  Rig plain(config, way(0));
  config.tsdf.far_store_kib = 8192;
  Rig rig(config, way(0));
  int most = 0, moved = 0;
  std::uint64_t work_plain = 0, work = 0;
  for (int n = 0; n < kFrames; ++n) {
    rig.see(s, way(n), 0.001);
    *plain.frame = *rig.frame;
    plain.step(true);
    ASSERT_EQ(rig.out.camera.X_WC.matrix(), plain.out.camera.X_WC.matrix()) << "frame " << n;
    ASSERT_EQ(rig.out.camera.claimed, plain.out.camera.claimed);
    EXPECT_EQ(rig.out.paging.refused + rig.out.paging.not_stored, 0);
    EXPECT_EQ(rig.out.integration.blocks_fetched, 0) << "was there before it was needed";
    most = std::max(most, rig.task->map().block_count());
    moved += rig.out.paging.blocks_moved;
    work_plain = std::max(work_plain, plain.out.work), work = std::max(work, rig.out.work);
  }
  const int all = plain.task->map().block_count();
  std::printf("  %d blocks in all, at most %d in the pool, %d moved; work %llu, with paging %llu\n",
              all, most, moved, static_cast<unsigned long long>(work_plain),
              static_cast<unsigned long long>(work));
  EXPECT_GE(plain.task->frames_claimed(), static_cast<std::uint64_t>(kFrames * 98 / 100));
  EXPECT_LT(most, all / 2);
  EXPECT_GT(moved, all) << "most of it went and came back";
  auto& nrt = rig.startup.token();
  EXPECT_EQ(perception::encode_map(nrt, rig.task->map(), rig.task->keyframes()),
            perception::encode_map(nrt, plain.task->map(), plain.task->keyframes()));
  EXPECT_LT(work, work_plain + work_plain / 4);
}

}  // namespace
}  // namespace tasks
