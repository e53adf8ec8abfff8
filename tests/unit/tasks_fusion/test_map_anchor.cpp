// What holds the map in its place: does it see the map move, and only that?
#include "tasks/fusion/map_anchor.hpp"

#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using perception::FrameView;
using perception::Intrinsics;
using perception::Pose;
using perception::TsdfMap;
using perception::Vec3;
using tests::AnalyticScene;

constexpr perception::icp::NoiseRule kNoise{0.0015F, 0.004F, 0.8F};
constexpr double kDepth_m = 1.8;

// A room that is fused at poses of the test's choice, whatever the camera's is.
struct Fused {
  rt::Startup startup;
  AnalyticScene room = tests::test_room();
  Intrinsics camera = tests::small_camera();
  Pose X_WC = tests::Rig::eye(0);
  rt::Random random{7};
  std::unique_ptr<perception::RgbdFrame> frame = std::make_unique<perception::RgbdFrame>();
  TsdfMap map;
  perception::RaycastMaps model{startup.token(), 256, 212};
  MapAnchor anchor{startup.token()};

  explicit Fused(double voxel_m = 0.02) : map(startup.token(), config(voxel_m)) {}
  static perception::TsdfConfig config(double voxel_m) {
    perception::TsdfConfig c = tests::coarse().tsdf;
    c.voxel_size_m = voxel_m;
    c.max_blocks = 16384;
    c.max_weight = 64;
    return c;
  }
  // Images taken at X_WC, said to be taken at X_said.
  void fuse(int images, const Pose& X_said) {
    for (int i = 0; i < images; ++i) {
      tests::fill_frame(room, camera, X_WC, 0.0015, random, *frame);
      ASSERT_FALSE(map.integrate(FrameView::of(*frame), X_said, 2).refused);
    }
    static_cast<void>(perception::raycast(map, camera, X_said, {}, model));
    // The camera rests; how often it is looked at does not matter afterwards.
    for (int i = 0; i < 40; ++i) anchor.update(map, model, kNoise, X_said, kDepth_m);
  }
  // Of the surface about the centre, in the camera's frame, mm.
  [[nodiscard]] Vec3 moved_mm() const {
    return 1e3 * (X_WC.linear().transpose() * anchor.moved().head<3>());
  }
};

TEST(MapAnchor, SeesTheMapMoveAndNothingWhereItStays) {
  Fused f;
  f.fuse(80, f.X_WC);
  ASSERT_GT(f.anchor.nodes(), 400);
  f.fuse(80, f.X_WC);
  std::printf("  stays: moved by %.3f mm\n", f.moved_mm().norm());
  EXPECT_LT(f.moved_mm().norm(), 0.15);
  Pose X_off = f.X_WC;
  X_off.translation() += f.X_WC.linear() * Vec3(0, 0, -0.002);
  f.fuse(150, X_off);
  const Vec3 moved = f.moved_mm();
  std::printf("  fused 2 mm nearer: moved by %.3f %.3f %.3f mm\n", moved.x(), moved.y(), moved.z());
  // To the side this room constrains little, where pixels are as wide as nodes.
  EXPECT_NEAR(moved.z(), -2, 0.8);
  // Poses are moved the other way, and not without bound.
  const Pose held = f.anchor.held(f.X_WC);
  const Vec3 back = f.X_WC.linear().transpose() * (held.translation() - f.X_WC.translation());
  EXPECT_GT(back.z(), 1e-4);
  EXPECT_LT(back.norm(), 2e-3);
}

TEST(MapAnchor, WhatChangesInTheSceneIsNoMotionOfTheMap) {
  Fused f;
  f.fuse(80, f.X_WC);
  ASSERT_GT(f.anchor.nodes(), 400);
  // Something is put before the camera: its nodes are new ones, those behind it are hidden.
  Pose X_WS = Pose::Identity();
  X_WS.translation() = f.X_WC * Vec3(0.1, 0, 1.0);
  f.room.boxes.push_back({X_WS, Vec3(0.1, 0.12, 0.1)});
  f.fuse(100, f.X_WC);
  std::printf("  a box comes: moved by %.3f mm\n", f.moved_mm().norm());
  EXPECT_LT(f.moved_mm().norm(), 0.15);
  f.room.boxes.pop_back();
  f.fuse(100, f.X_WC);
  std::printf("  and goes: moved by %.3f mm\n", f.moved_mm().norm());
  EXPECT_LT(f.moved_mm().norm(), 0.15);
}

// A pixel of this camera is a voxel of 10 mm wide at 1.8 m: most of the room is farther, and what
// is near would be held in directions that it alone does not show.
TEST(MapAnchor, HoldsNothingWherePixelsAreWiderThanVoxels) {
  Fused f(0.01);
  f.fuse(80, f.X_WC);
  ASSERT_GT(f.map.block_count(), 1000);
  EXPECT_EQ(f.anchor.nodes(), 0);
  Pose X_off = f.X_WC;
  X_off.translation() += f.X_WC.linear() * Vec3(0, 0, -0.002);
  f.fuse(80, X_off);
  EXPECT_EQ(f.anchor.moved().norm(), 0);
  EXPECT_EQ(f.anchor.held(f.X_WC).matrix(), f.X_WC.matrix());
}

TEST(MapAnchor, ForgetsWhereTheCameraLeft) {
  Fused f;
  EXPECT_EQ(f.anchor.held(f.X_WC).matrix(), f.X_WC.matrix()) << "nothing known: nothing moved";
  f.fuse(20, f.X_WC);
  EXPECT_EQ(f.anchor.nodes(), 0) << "not settled yet";
  f.fuse(60, f.X_WC);
  Pose X_off = f.X_WC;
  X_off.translation() += f.X_WC.linear() * Vec3(0, 0, -0.002);
  f.fuse(60, X_off);
  EXPECT_GT(f.anchor.moved().norm(), 1e-4);
  f.map.clear();
  f.anchor.update(f.map, f.model, kNoise, X_off, kDepth_m);
  EXPECT_EQ(f.anchor.nodes(), 0) << "another map";
  EXPECT_EQ(f.anchor.moved().norm(), 0);
  // A camera that moves by a centimetre a frame is never held.
  f.fuse(80, f.X_WC);
  EXPECT_GT(f.anchor.nodes(), 400);
  for (int i = 1; i < 60; ++i) {
    X_off = f.X_WC;
    X_off.translation().y() += 0.01 * i;
    f.anchor.update(f.map, f.model, kNoise, X_off, kDepth_m);
    EXPECT_EQ(f.anchor.nodes() > 0, i <= 1) << i;
  }
}

}  // namespace
}  // namespace tasks
