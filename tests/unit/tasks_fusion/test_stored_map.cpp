// A map of another day, and a map that is larger than its pool.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::coarse;
using tests::Rig;

Pose turned(double yaw, double x = 0, double y = 0) {
  const Vec3 eye(x, y, 1.0);
  return tests::look_at(eye, eye + Vec3(std::cos(yaw), std::sin(yaw), -0.35));
}

// A hall with things along its walls.
AnalyticScene hall() {
  AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
              {Vec3(2.6, 0, 0), -Vec3::UnitX()},
              {Vec3(-2.6, 0, 0), Vec3::UnitX()},
              {Vec3(0, 2, 0), -Vec3::UnitY()},
              {Vec3(0, -2, 0), Vec3::UnitY()}};
  const auto box = [&](double x, double y, double z, Vec3 size, double yaw) {
    Pose X = Pose::Identity();
    X.linear() = Eigen::AngleAxisd(yaw, Vec3::UnitZ()).toRotationMatrix();
    X.translation() = Vec3(x, y, z);
    s.boxes.push_back({X, size / 2});
  };
  box(2.0, 1.2, 0.35, Vec3(0.5, 0.4, 0.7), 0.4);
  box(1.6, -0.9, 0.2, Vec3(0.3, 0.5, 0.4), 0.9);
  box(0.3, 1.5, 0.5, Vec3(0.4, 0.3, 1.0), -0.3);
  box(-1.6, 0.9, 0.25, Vec3(0.6, 0.3, 0.5), 0.2);
  box(-1.9, -1.1, 0.4, Vec3(0.3, 0.3, 0.8), -0.5);
  box(0.2, -1.4, 0.3, Vec3(0.5, 0.3, 0.6), 0.7);
  return s;
}

void tour(Rig& rig, const AnalyticScene& scene, int frames = 72) {
  for (int i = 0; i < frames; ++i) {
    rig.see(scene, turned(2 * std::numbers::pi * i / frames), 0.0015);
    ASSERT_TRUE(rig.out.camera.claimed) << "frame " << i;
  }
}

perception::MapFile stored(Rig& rig) {
  auto& nrt = rig.startup.token();
  auto file = perception::parse_map(
      nrt, perception::encode_map(nrt, rig.task->map(), rig.task->keyframes()), "hall.map");
  EXPECT_TRUE(file);
  return std::move(file).value();
}

TEST(StoredMap, TheCameraIsFoundInItWithin15FramesAndNowhereElse) {
  const AnalyticScene scene = hall();
  Rig before(coarse(), turned(0));
  tour(before, scene);
  const perception::MapFile file = stored(before);
  for (const double yaw : {0.1, 1.9, -2.2}) {
    Rig rig(coarse(), turned(0));
    ASSERT_TRUE(rig.task->load_map(rig.startup.token(), file));
    EXPECT_EQ(rig.task->map().block_count(), before.task->map().block_count());
    int took = 0;
    do {
      ++took;
      rig.see(scene, turned(yaw + 0.002 * took, 0.06), 0.0015);
    } while (!rig.out.camera.claimed && took < 15);
    ASSERT_TRUE(rig.out.camera.claimed) << "yaw " << yaw;
    EXPECT_GE(took, 2) << "two frames must agree";
    const double off =
        (rig.out.camera.X_WC.translation() - turned(yaw + 0.002 * took, 0.06).translation()).norm();
    std::printf("  yaw %.1f: found after %d frames, %.1f mm off\n", yaw, took, 1000 * off);
    EXPECT_LT(off, 0.02);
    // And from there on it is a map like any other.
    for (int i = 0; i < 10; ++i) {
      rig.see(scene, turned(yaw + 0.03 + 0.01 * i, 0.06), 0.0015);
      EXPECT_TRUE(rig.out.camera.claimed && rig.out.integrated);
    }
  }
  AnalyticScene elsewhere;
  elsewhere.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
                      {Vec3(1.2, 0, 0.5), Vec3(-1, 0.6, 0.2).normalized()}};
  Rig rig(coarse(), turned(0));
  ASSERT_TRUE(rig.task->load_map(rig.startup.token(), file));
  const auto content = rig.task->map().checksum();
  for (int i = 0; i < 15; ++i) {
    rig.see(elsewhere, turned(0.01 * i), 0.0015);
    EXPECT_FALSE(rig.out.camera.claimed);
    EXPECT_EQ(rig.health.fault, kFaultFusionLost);
  }
  EXPECT_EQ(rig.task->map().checksum(), content) << "nothing is fused into a map one is not in";
}

TEST(StoredMap, AWrongOneIsRefusedAndTheTaskIsAsNew) {
  const AnalyticScene scene = hall();
  Rig before(coarse(), turned(0));
  before.see(scene, turned(0), 0.0015);
  const perception::MapFile file = stored(before);
  FusionConfig finer = coarse();
  finer.tsdf.voxel_size_m = 0.01;
  Rig rig(finer, turned(0));
  const auto refused = rig.task->load_map(rig.startup.token(), file);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("voxels of 0.02"), std::string::npos) << refused.error();
  rig.see(scene, turned(0), 0.0015);
  EXPECT_TRUE(rig.out.camera.claimed) << "the first image defines the map";
}

// A way of 7 m and back through a passage, beside a map that keeps it all in its pool.
TEST(StoredMap, FarBlocksComeAndGoAndTrackingDoesNotNotice) {
  AnalyticScene s;
  s.planes = {{Vec3(0, 0, 0), Vec3::UnitZ()},
              {Vec3(0, 1, 0), -Vec3::UnitY()},
              {Vec3(0, -1, 0), Vec3::UnitY()}};
  for (int n = 0; n < 14; ++n) {
    Pose X = Pose::Identity();
    X.linear() = Eigen::AngleAxisd(0.5 * n, Vec3::UnitZ()).toRotationMatrix();
    X.translation() = Vec3(0.9 + 0.8 * n, n % 2 == 0 ? 0.6 : -0.6, 0.25);
    s.boxes.push_back({X, Vec3(0.2, 0.15, 0.25 + 0.03 * (n % 4))});
  }
  const auto way = [](int n) {
    const double x = 0.06 * (n < 120 ? n : 240 - n);
    return tests::look_at(Vec3(x, 0.1 * std::sin(0.05 * n), 0.9), Vec3(x + 1.5, 0, 0.2));
  };
  FusionConfig config = coarse();
  config.tsdf.max_depth_m = config.tracker.preprocess.depth_max_m = 2.0;
  config.tsdf.far_m = 3.0;
  config.tsdf.far_store_kib = 0;
  Rig plain(config, way(0));
  config.tsdf.far_store_kib = 4096;
  Rig rig(config, way(0));
  int most = 0, moved = 0;
  std::uint64_t work_plain = 0, work = 0;
  for (int n = 0; n < 240; ++n) {
    plain.see(s, way(n), 0.001);
    rig.see(s, way(n), 0.001);
    ASSERT_EQ(rig.out.camera.X_WC.matrix(), plain.out.camera.X_WC.matrix()) << "frame " << n;
    ASSERT_EQ(rig.out.camera.claimed, plain.out.camera.claimed);
    EXPECT_EQ(rig.out.paging.refused + rig.out.paging.not_stored, 0);
    EXPECT_EQ(rig.out.integration.blocks_fetched, 0) << "was there before it was needed";
    most = std::max(most, rig.task->map().block_count());
    moved += rig.out.paging.blocks_moved;
    work_plain = std::max(work_plain, plain.out.work), work = std::max(work, rig.out.work);
  }
  std::printf("  %d blocks in all, at most %d in the pool, %d moved; work %llu, with paging %llu\n",
              plain.task->map().block_count(), most, moved,
              static_cast<unsigned long long>(work_plain), static_cast<unsigned long long>(work));
  EXPECT_GT(plain.task->frames_claimed(), 230U);
  // 3 m to either side, in chunks of 1.28 m, of a way of 7.2 m: most of it is near from its middle.
  EXPECT_LT(most, plain.task->map().block_count());
  EXPECT_GT(moved, 0);
  auto& nrt = rig.startup.token();
  EXPECT_EQ(perception::encode_map(nrt, rig.task->map(), rig.task->keyframes()),
            perception::encode_map(nrt, plain.task->map(), plain.task->keyframes()));
  EXPECT_LT(work, work_plain + work_plain / 4);
}

}  // namespace
}  // namespace tasks
