// Scenes and inputs that defeat tracking: right, or silent; never wrong and claimed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <vector>

#include "rt/quantile.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::coarse;
using tests::kDt;
using tests::kWrong_m;
using tests::Rig;

struct Score {
  int frames = 0, claimed = 0, wrong = 0;
  double worst_claimed_mm = 0, worst_mm = 0;
};

// Drives the rig along `path`; odometry of the share given, with this scale error along the way.
Score drive(Rig& rig, const AnalyticScene& scene, int frames, double sigma_m,
            const std::function<Pose(int)>& path, double odometry_scale = 0) {
  Score s;
  Pose X_OB = Pose::Identity();
  const Pose align = path(0) * rig.setup.X_WC0.inverse();
  for (int i = 0; i < frames; ++i) {
    if (odometry_scale > 0) {
      if (i > 0) {
        Pose step = path(i - 1).inverse() * path(i);
        step.translation() *= odometry_scale;
        X_OB = X_OB * step;
      }
      OdometryPrior o;
      o.taken = rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * kDt - 0.02)};
      o.X_OB = X_OB;
      rig.in.odometry = o;
    }
    rig.see(scene, path(i), sigma_m);
    const double off = ((align * rig.out.camera.X_WC).translation() - path(i).translation()).norm();
    ++s.frames;
    s.worst_mm = std::max(s.worst_mm, 1000 * off);
    if (!rig.out.camera.claimed) continue;
    ++s.claimed;
    s.worst_claimed_mm = std::max(s.worst_claimed_mm, 1000 * off);
    s.wrong += off > kWrong_m ? 1 : 0;
  }
  return s;
}

void print(const char* name, const Score& s) {
  std::printf("  %s: claimed %d of %d, worst claimed %.1f mm, worst of all %.1f mm, wrong %d\n",
              name, s.claimed, s.frames, s.worst_claimed_mm, s.worst_mm, s.wrong);
}

AnalyticScene wall() {
  AnalyticScene s;
  s.planes = {{Vec3(1.2, 0, 0), -Vec3::UnitX()}};
  return s;
}
Pose along_wall(double y) { return tests::look_at(Vec3(0, y, 0.5), Vec3(1.2, y, 0.5)); }
Pose sliding(int i) { return along_wall(0.005 * i); }

TEST(Stability, SlidingWallIsClaimedWithOdometryAndNotWithout) {
  for (const double scale : {1.01, 0.99}) {
    Rig rig(coarse(), sliding(0));
    const Score s = drive(rig, wall(), 40, 0.0015, sliding, scale);
    print("wall, odometry 1 % off", s);
    EXPECT_EQ(s.claimed, 40);
    EXPECT_LE(s.worst_claimed_mm, 5.0);
  }
  Rig rig(coarse(), sliding(0));
  const Score s = drive(rig, wall(), 40, 0.0015, sliding);
  print("wall, no odometry", s);
  EXPECT_LE(s.claimed, 2);
  EXPECT_EQ(s.wrong, 0);
}

TEST(Stability, CorridorHasOneFreeDirection) {
  AnalyticScene corridor;
  corridor.planes = {{Vec3(0, 0.9, 0), -Vec3::UnitY()},
                     {Vec3(0, -0.9, 0), Vec3::UnitY()},
                     {Vec3(0, 0, 0), Vec3::UnitZ()}};
  const auto path = [](int i) {
    return tests::look_at(Vec3(0.01 * i, 0, 1.0), Vec3(0.01 * i + 2, 0.05, 0.7));
  };
  Rig with(coarse(), path(0)), without(coarse(), path(0));
  const Score odometry = drive(with, corridor, 40, 0.0015, path, 1.01);
  print("corridor, odometry 1 % off", odometry);
  EXPECT_EQ(odometry.claimed, 40);
  EXPECT_LE(odometry.worst_claimed_mm, 5.0);
  EXPECT_EQ(with.out.tracking.degenerate_count, 1);
  EXPECT_GT(std::abs(with.out.tracking.degenerate_W(0, 0)), 0.9) << "along the corridor";
  const Score silent = drive(without, corridor, 40, 0.0015, path);
  print("corridor, no odometry", silent);
  EXPECT_LE(silent.claimed, 2);
  EXPECT_EQ(silent.wrong, 0);
}

TEST(Stability, WallWithASmallBoxIsRightOrSilent) {
  for (const double y : {0.0, 0.15, 0.3}) {
    AnalyticScene scene = wall();
    Pose X = Pose::Identity();
    X.translation() = Vec3(1.17, y, 0.5);
    scene.boxes.push_back({X, Vec3(0.03, 0.03, 0.03)});
    Rig rig(coarse(), sliding(0));
    const Score s = drive(rig, scene, 40, 0.0015, sliding);
    print("wall with a box of 60 mm", s);
    EXPECT_LE(s.worst_claimed_mm, 20.0);
    Rig guided(coarse(), sliding(0));
    const Score o = drive(guided, scene, 40, 0.0015, sliding, 1.01);
    print("the same, odometry 1 % off", o);
    EXPECT_EQ(o.claimed, 40);
    EXPECT_LE(o.worst_claimed_mm, 20.0);
  }
}

// The same at the product's size: more points, finer voxels, and so less noise to hide structure
// that is not there.
TEST(Stability, SlidingWallAndSmallBoxAtFullSize) {
  FusionConfig full;
  full.tsdf.max_blocks = 8192;
  full.view_period_frames = 0;
  const auto run = [&](const char* name, const AnalyticScene& scene, double odometry) {
    Rig rig(full, sliding(0), tests::kinect2_camera());
    const Score s = drive(rig, scene, 40, 0.0015, sliding, odometry);
    print(name, s);
    return s;
  };
  const Score bare = run("512 x 424, wall, no odometry", wall(), 0);
  EXPECT_LE(bare.claimed, 2);
  EXPECT_EQ(bare.wrong, 0);
  const Score guided = run("512 x 424, wall, odometry 1 % off", wall(), 1.01);
  EXPECT_EQ(guided.claimed, 40);
  EXPECT_LE(guided.worst_claimed_mm, 5.0);
  AnalyticScene boxed = wall();
  Pose X = Pose::Identity();
  X.translation() = Vec3(1.17, 0.1, 0.5);
  boxed.boxes.push_back({X, Vec3(0.03, 0.03, 0.03)});
  EXPECT_LE(run("512 x 424, wall with a box of 60 mm", boxed, 0).worst_claimed_mm, 20.0);
}

// A wall that ends: the camera slides off a flat wall on to structure and back.
TEST(Stability, StructureAfterABareWallIsNotTakenForTheOldPlace) {
  AnalyticScene scene = wall();
  for (int k = 0; k < 4; ++k) {
    Pose X = Pose::Identity();
    X.translation() = Vec3(1.1, 1.6 + 0.3 * k, 0.3 + 0.15 * (k % 3));
    scene.boxes.push_back({X, Vec3(0.1, 0.06, 0.1)});
    X.translation() = Vec3(1.1, -0.7 + 0.3 * k, 0.3 + 0.15 * (k % 3));
    scene.boxes.push_back({X, Vec3(0.1, 0.06, 0.1)});  // look-alike
  }
  const auto path = [](int i) { return along_wall(-0.25 + 0.03 * i); };
  Rig rig(coarse(), path(0));
  const Score s = drive(rig, scene, 80, 0.0015, path);
  print("two groups of boxes a bare wall apart", s);
  EXPECT_EQ(s.wrong, 0);
}

// The camera moves on by several frames between two images.
TEST(Stability, StrideOverFramesOfARoomIsRightOrLost) {
  for (const int stride : {1, 2, 4, 8}) {
    const AnalyticScene room = tests::test_room();
    const auto path = [stride](int i) {
      const double t = stride * i * kDt;
      const Vec3 eye(-0.2 + 0.25 * std::sin(0.8 * t), 0.1 - 0.2 * std::sin(1.1 * t), 0.9);
      const double yaw = 0.35 * std::sin(1.3 * t);
      return tests::look_at(eye, eye + Vec3(2 * std::cos(yaw), 2 * std::sin(yaw), -0.6));
    };
    Rig rig(coarse(), path(0));
    const Score s = drive(rig, room, std::max(10, 48 / stride), 0.0015, path);
    char name[64];
    std::snprintf(name, sizeof name, "room, every %d. frame", stride);
    print(name, s);
    EXPECT_EQ(s.wrong, 0);
    if (stride <= 4) {
      EXPECT_EQ(s.claimed, s.frames);
    }
  }
}

// ---------------------------------------------------------------- bad images

TEST(Stability, ImagesWithoutAScene) {
  const AnalyticScene room = tests::test_room();
  using Spoil = std::function<void(Rig&, perception::RgbdFrame&)>;
  const auto fill = [](perception::RgbdFrame& f, std::uint16_t mm) { f.depth_mm.fill(mm); };
  const struct {
    const char* name;
    Spoil spoil;
  } cases[] = {
      {"all zero", [&](Rig&, auto& f) { fill(f, 0); }},
      {"saturated", [&](Rig&, auto& f) { fill(f, 65535); }},
      {"one pixel", [&](Rig&, auto& f) { fill(f, 0), f.depth_mm[100 * 256 + 77] = 1500; }},
      {"one depth everywhere", [&](Rig&, auto& f) { fill(f, 1500); }},
      {"too near", [&](Rig&, auto& f) { fill(f, 20); }},
      {"random depths",
       [](Rig& r, auto& f) {
         for (auto& d : f.depth_mm) d = static_cast<std::uint16_t>(r.random.uniform() * 5000);
       }},
      {"chequered by a depth step",
       [](Rig&, auto& f) {
         for (int i = 0; i < 256 * 212; ++i)
           f.depth_mm[static_cast<std::size_t>(i)] = (i / 8 + i / 2048) % 2 ? 900 : 2600;
       }},
      {"one step down the middle",
       [](Rig&, auto& f) {
         for (int i = 0; i < 256 * 212; ++i)
           f.depth_mm[static_cast<std::size_t>(i)] = i % 256 < 128 ? 900 : 2600;
       }},
      {"every second row missing",
       [](Rig&, auto& f) {
         for (int i = 0; i < 256 * 212; ++i)
           if ((i / 256) % 2) f.depth_mm[static_cast<std::size_t>(i)] = 0;
       }},
      {"not a number in the camera",
       [](Rig&, auto& f) { f.intrinsics.fx = std::numeric_limits<double>::quiet_NaN(); }},
      {"not a number in odometry",
       [&](Rig& r, auto& f) {
         OdometryPrior o;
         o.taken = f.exposure;
         o.X_OB.matrix().setConstant(std::numeric_limits<double>::quiet_NaN());
         r.in.odometry = o;
         fill(f, 0);
       }},
  };
  for (const auto& c : cases) {
    Rig rig;
    for (int i = 0; i < 4; ++i) rig.see(room, Rig::eye(i));
    const auto before = rig.task->map().checksum();
    for (int i = 4; i < 7; ++i) {
      tests::fill_frame(room, rig.setup.camera, Rig::eye(i), 0.001, rig.random, *rig.frame);
      rig.frame->exposure =
          rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * kDt - 0.02)};
      c.spoil(rig, *rig.frame);
      rig.step(true);
      const bool claimed = rig.out.camera_written && rig.out.camera.claimed;
      const double off = (rig.out.camera.X_WC.translation() - Rig::eye(i).translation()).norm();
      EXPECT_FALSE(claimed && off > 0.02) << c.name;
      if (!claimed) {
        EXPECT_EQ(rig.task->map().checksum(), before) << c.name;
      }
      EXPECT_TRUE(rig.out.camera.X_WC.matrix().allFinite()) << c.name;
    }
    int claimed = 0;
    for (int i = 7; i < 12; ++i) {
      rig.see(room, Rig::eye(i));
      claimed += rig.out.camera.claimed ? 1 : 0;
    }
    EXPECT_GE(claimed, 3) << c.name << ": comes back";
    EXPECT_LT((rig.out.camera.X_WC.translation() - Rig::eye(11).translation()).norm(), 0.006)
        << c.name;
  }
}

// TELETACT_STILL_FRAMES=10000 for the long run: neither the pose nor the surface moves.
TEST(Stability, NoisyStillRoomDoesNotDrift) {
  const char* asked = std::getenv("TELETACT_STILL_FRAMES");
  const int frames = asked != nullptr ? std::max(200, std::atoi(asked)) : 300;
  const AnalyticScene room = tests::test_room();
  Rig rig;
  const auto depth = tests::cast_depth(room, rig.setup.camera, Rig::eye(0));
  // Mean of what the map shows nearer than the truth, and its 95 % quantile either way, mm.
  const auto surface = [&](double& mean_mm, double& p95_mm) {
    perception::RaycastMaps maps(rig.startup.token(), 256, 212);
    static_cast<void>(
        perception::raycast(rig.task->map(), rig.setup.camera, Rig::eye(0), {}, maps));
    std::vector<double> off;
    double sum = 0;
    for (int v = 4; v < 208; ++v) {
      for (int u = 4; u < 252; ++u) {
        const double z = depth[static_cast<std::size_t>(v * 256 + u)];
        if (!maps.hit(u, v) || z <= 0) continue;
        const double d = 1000 * (z - static_cast<double>(maps.at(u, v)[3]));
        if (std::abs(d) > 30) continue;  // at a depth step the pixel sees the other side
        sum += d;
        off.push_back(std::abs(d));
      }
    }
    mean_mm = sum / static_cast<double>(off.size());
    p95_mm = rt::quantile(off, 0.95);
  };
  Score s = drive(rig, room, 100, 0.0015, [](int) { return Rig::eye(0); });
  double early_mm = 0, early_p95_mm = 0, late_mm = 0, late_p95_mm = 0;
  surface(early_mm, early_p95_mm);
  const Score rest = drive(rig, room, frames - 100, 0.0015, [](int) { return Rig::eye(0); });
  surface(late_mm, late_p95_mm);
  print("still camera", s);
  print("the rest of the run", rest);
  std::printf(
      "  surface nearer than the truth, mean (p95 of all): %.2f (%.2f) mm after 100 frames, "
      "%.2f (%.2f) after %d\n",
      early_mm, early_p95_mm, late_mm, late_p95_mm, frames);
  EXPECT_EQ(s.claimed + rest.claimed, frames);
  EXPECT_LT(s.worst_mm, 2.0);
  EXPECT_LT(rest.worst_mm, 2.0);
  EXPECT_LT(std::abs(late_mm - early_mm), 0.5);
  EXPECT_LT(late_p95_mm, early_p95_mm + 0.5);
}

}  // namespace
}  // namespace tasks
