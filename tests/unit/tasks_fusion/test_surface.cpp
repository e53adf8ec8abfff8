// The ray cast of the published method of touch: made where the setup asks, in parts or in one job,
// from the last camera that was claimed when it began. Oracle: a cast of the same map from that
// pose, made here, and the analytic scene.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "rt/quantile.hpp"
#include "rt/sched/worker_pool.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using perception::RaycastMaps;
using tests::AnalyticScene;
using tests::Rig;

struct Asked : Rig {
  SurfacePoints points;
  explicit Asked(bool ask = true, int periods = 1) {
    setup.ray_cast = ask;
    FusionConfig config = tests::coarse();
    config.surface_periods = periods;
    task = std::make_unique<FusionTask>(startup.token(), config, setup);
    points.resize(pixels());
    out.surface = &points;
  }
  [[nodiscard]] std::size_t pixels() const {
    return static_cast<std::size_t>(setup.camera.width) *
           static_cast<std::size_t>(setup.camera.height);
  }
};

// Largest distance of a published point from that of a direct cast, m; and of a normal. Equal rays
// must meet the same.
struct Off {
  double point_m = 0, normal = 0;
  int hits = 0, differ = 0;
};
Off against_direct_cast(Asked& rig) {
  const auto& camera = rig.setup.camera;
  RaycastMaps maps(rig.startup.token(), camera.width, camera.height);
  perception::RaycastOptions o;
  o.min_weight = 2;  // definition of "observed"
  o.max_depth_m =
      rig.task->config().tracker.preprocess.depth_max_m + rig.task->config().tsdf.truncation_m;
  (void)perception::raycast(rig.task->map(), camera, rig.points.X_WC, o, maps);
  Off off;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const auto i = static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
                     static_cast<std::size_t>(u);
      const bool here = rig.points.x[i] < SurfacePoints::kFar;
      off.differ += here != maps.hit(u, v) ? 1 : 0;
      if (!here || !maps.hit(u, v)) continue;
      ++off.hits;
      const Vec3 p = rig.points.X_WC * maps.vertex_C(u, v).cast<double>();
      const Vec3 n = rig.points.X_WC.linear() * maps.normal_C(u, v).cast<double>();
      off.point_m = std::max(off.point_m, (rig.points.point(i) - p).norm());
      off.normal = std::max(off.normal, (rig.points.normal(i) - n).norm());
    }
  }
  return off;
}

TEST(Surface, ThePointsAreThoseOfADirectCastFromTheClaimedPose) {
  const AnalyticScene room = tests::test_room();
  Asked rig;
  for (int i = 0; i < 8; ++i) {
    rig.see(room, Rig::eye(i));
    ASSERT_TRUE(rig.out.surface_written);
    ASSERT_TRUE(rig.out.camera.claimed);
    EXPECT_EQ(rig.points.seq, static_cast<std::uint64_t>(i + 1));
    EXPECT_EQ(rig.points.count, rig.pixels());
    EXPECT_EQ(rig.points.exposure, rig.frame->exposure);
    EXPECT_TRUE(rig.points.X_WC.matrix() == rig.out.camera.X_WC.matrix());
    const Off off = against_direct_cast(rig);
    EXPECT_EQ(off.differ, 0);
    EXPECT_LT(off.point_m, 5e-6) << "float";
    EXPECT_LT(off.normal, 1e-6);
    if (i < 2) continue;  // observed twice at least
    EXPECT_GT(off.hits, static_cast<int>(rig.pixels()) * 2 / 3);
  }
  // And the surface is the room's: along the ray, as the room itself says.
  std::vector<double> error_m;
  for (std::size_t i = 0; i < rig.points.count; ++i) {
    if (!(rig.points.x[i] < SurfacePoints::kFar)) continue;
    const Vec3 from = rig.points.X_WC.translation(),
               way = (rig.points.point(i) - from).normalized();
    error_m.push_back(std::abs(room.cast(from, way).t - (rig.points.point(i) - from).norm()));
    ASSERT_NEAR(rig.points.normal(i).norm(), 1, 1e-5);
    ASSERT_LT(rig.points.normal(i).dot(way), 0) << "towards the camera";
  }
  const double median_m = rt::quantile(error_m, 0.5);
  std::printf("  %zu points, median off the room %.2f mm\n", error_m.size(), 1e3 * median_m);
  EXPECT_LT(median_m, 0.003);
}

// In parts: whole every n-th period, all of one pose, and of a map that rests what a cast in one
// job is.
TEST(Surface, InPartsItIsTheSameCastLater) {
  const AnalyticScene room = tests::test_room();
  for (const int periods : {2, 5, 12, 15}) {
    Asked rig(true, periods);
    for (int i = 0; i < 8; ++i) rig.see(room, Rig::eye(i));
    int jobs = 0, whole = 0, most_jobs = 0;
    std::uint64_t seq = rig.points.seq;
    for (int i = 0; i < 3 * periods; ++i) {
      rig.step(false);  // the map rests from here on
      ++jobs;
      if (!rig.out.surface_written) {
        EXPECT_EQ(rig.points.seq, seq) << "not told before it is whole";
        continue;
      }
      EXPECT_EQ(rig.points.seq, ++seq);
      most_jobs = std::max(most_jobs, jobs);
      jobs = 0;
      if (++whole < 2) continue;  // this one began while images came
      EXPECT_TRUE(rig.points.X_WC.matrix() == rig.task->camera().matrix());
      const Off off = against_direct_cast(rig);
      EXPECT_EQ(off.differ, 0) << periods;
      EXPECT_LT(off.point_m, 5e-6) << periods;
      EXPECT_LT(off.normal, 1e-6) << periods;
      EXPECT_GT(off.hits, static_cast<int>(rig.pixels()) * 2 / 3);
    }
    EXPECT_GE(whole, 2) << periods;
    EXPECT_LE(most_jobs, periods);
  }
}

// While the camera goes on, a cast keeps the pose that it began with, and says how old its oldest
// rows are.
TEST(Surface, APartKeepsThePoseThatTheCastBeganWith) {
  const AnalyticScene room = tests::test_room();
  Asked rig(true, 4);
  std::vector<Pose> poses;
  std::vector<rt::Time> exposures;
  int whole = 0;
  for (int i = 0; i < 16; ++i) {
    rig.see(room, Rig::eye(i));
    ASSERT_TRUE(rig.out.camera.claimed);
    poses.push_back(rig.out.camera.X_WC);
    exposures.push_back(rig.frame->exposure);
    if (!rig.out.surface_written) continue;
    ++whole;
    const std::size_t began = poses.size() - 4;
    EXPECT_TRUE(rig.points.X_WC.matrix() == poses[began].matrix());
    EXPECT_EQ(rig.points.exposure, exposures[began]);
  }
  EXPECT_EQ(whole, 4);
}

// Published again whether a new image came or not; nothing before the first claim.
TEST(Surface, ItComesEveryPeriodFromTheFirstClaimOn) {
  const AnalyticScene room = tests::test_room();
  Asked rig;
  rig.step(false);
  EXPECT_FALSE(rig.out.surface_written);
  EXPECT_EQ(rig.points.seq, 0U);
  for (int i = 0; i < 6; ++i) rig.see(room, Rig::eye(0));
  const auto exposure = rig.points.exposure;
  const auto seq = rig.points.seq;
  rig.step(false);
  EXPECT_TRUE(rig.out.surface_written);
  EXPECT_EQ(rig.points.seq, seq + 1);
  EXPECT_EQ(rig.points.exposure, exposure) << "no younger than the map";
  EXPECT_EQ(rig.points.fused,
            rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period - 1) * tests::kDt)});
}

// A camera that sees nothing claims nothing: the cast stays where it was claimed last, of the map
// as it is.
TEST(Surface, ALostCameraCastsFromWhereItWasClaimedLast) {
  const AnalyticScene room = tests::test_room();
  Asked rig;
  for (int i = 0; i < 6; ++i) rig.see(room, Rig::eye(i));
  const Pose X_WC = rig.points.X_WC;
  const auto exposure = rig.points.exposure;
  for (int i = 0; i < 8; ++i) {
    rig.see(AnalyticScene{}, Rig::eye(6));
    EXPECT_FALSE(rig.out.camera.claimed);
    ASSERT_TRUE(rig.out.surface_written);
    EXPECT_TRUE(rig.points.X_WC.matrix() == X_WC.matrix());
    EXPECT_EQ(rig.points.exposure, exposure);
    EXPECT_EQ(against_direct_cast(rig).differ, 0);
  }
}

// What the operator clears is gone from it in the same job, without another image.
TEST(Surface, WhatIsClearedIsGoneFromItAtOnce) {
  const AnalyticScene room = tests::test_room();
  Asked rig;
  for (int i = 0; i < 6; ++i) rig.see(room, Rig::eye(0));
  const Eigen::AlignedBox3d box(Vec3(1.4, 0.15, 0.12), Vec3(2.0, 0.85, 0.45));
  const auto inside = [&] {
    int n = 0;
    for (std::size_t i = 0; i < rig.points.count; ++i)
      n += rig.points.x[i] < SurfacePoints::kFar && box.contains(rig.points.point(i)) ? 1 : 0;
    return n;
  };
  ASSERT_GT(inside(), 20);
  rig.in.clear_W = box;
  rig.step(false);
  ASSERT_FALSE(rig.task->clearing());
  EXPECT_EQ(inside(), 0);
}

TEST(Surface, NobodyAskedForItNothingIsMade) {
  const AnalyticScene room = tests::test_room();
  Asked rig(false), asked;
  for (int i = 0; i < 4; ++i) {
    rig.see(room, Rig::eye(i));
    asked.see(room, Rig::eye(i));
    EXPECT_FALSE(rig.out.surface_written);
    EXPECT_EQ(rig.points.seq, 0U);
    // And nothing else of fusion is another with it than without.
    EXPECT_EQ(rig.task->map().checksum(), asked.task->map().checksum());
    EXPECT_EQ(rig.patch->checksum, asked.patch->checksum);
    EXPECT_TRUE(rig.out.camera.X_WC.matrix() == asked.out.camera.X_WC.matrix());
    EXPECT_LT(rig.out.work, asked.out.work) << "it is counted";
  }
}

TEST(Surface, ASlotThatIsTooSmallIsLeftAsItWas) {
  Asked rig;
  rig.points.resize(rig.pixels() - SurfacePoints::kLanes);
  for (int i = 0; i < 4; ++i) rig.see(tests::test_room(), Rig::eye(i));
  EXPECT_FALSE(rig.out.surface_written);
  EXPECT_EQ(rig.points.seq, 0U);
}

TEST(Surface, AnyNumberOfThreadsGivesTheSameBytes) {
  const AnalyticScene room = tests::test_room();
  Asked alone, helped;
  rt::InlineForkJoin crew(2, false);
  helped.task->use(crew);
  for (int i = 0; i < 4; ++i) {
    alone.see(room, Rig::eye(i));
    helped.see(room, Rig::eye(i));
    EXPECT_TRUE(alone.points.x == helped.points.x && alone.points.y == helped.points.y &&
                alone.points.z == helped.points.z && alone.points.nx == helped.points.nx &&
                alone.points.ny == helped.points.ny && alone.points.nz == helped.points.nz);
  }
  EXPECT_GT(crew.forks(), 0);
}

}  // namespace
}  // namespace tasks
