// Small views aligned to each other: the way between two cameras comes out, and what the other has
// seen through.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include "perception/relocalisation/thumbnail_fit.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

struct Views {
  rt::Startup startup;
  Intrinsics camera = tests::small_camera();
  TrackingPyramid pyramid{startup.token(), {}, 256, 212};
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
  rt::Random random{1};

  const DepthLevel& see(const tests::AnalyticScene& scene, const Pose& X_WC) {
    tests::fill_frame(scene, camera, X_WC, 0.0015, random, *frame);
    pyramid.build(frame->depth(), camera, 1);
    return pyramid.level(TrackingPyramid::kLevels - 1);
  }
};

Pose from(double x, double y) { return tests::look_at(Vec3(x, y, 0.9), Vec3(x + 2, y - 0.1, 0.2)); }

TEST(ThumbnailFit, FindsTheWayBetweenTwoViewsOfAPlace) {
  Views views;
  const ThumbnailAligner aligner(views.camera);
  const tests::AnalyticScene room = tests::test_room();
  const Pose X_WK = from(-0.2, 0.1);
  const Thumbnail kept = make_thumbnail(views.see(room, X_WK), {});
  double worst_m = 0, worst_deg = 0, most_against = 0, least_close = 1;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    rt::Random random(seed);
    const Pose X_KS = tests::random_motion(random, 0.35, 0.14);
    CellView seen;
    fill_cell_view(views.see(room, X_WK * X_KS), seen);
    ThumbnailFit fit;
    rt_guard::reset();
    {
      rt::Section section;
      fit = aligner.align(seen, kept, Pose::Identity());
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    const Pose off = X_KS.inverse() * fit.X_KS;
    worst_m = std::max(worst_m, off.translation().norm());
    worst_deg = std::max(worst_deg, rotation_angle(off.linear()) * 180 / std::numbers::pi);
    most_against = std::max(most_against, fit.against);
    least_close = std::min(least_close, fit.close);
  }
  std::printf("  off at most %.3f m and %.2f degrees; against at most %.4f, close at least %.3f\n",
              worst_m, worst_deg, most_against, least_close);
  // Within what ICP at full size finds back from.
  EXPECT_LE(worst_m, 0.10);
  EXPECT_LE(worst_deg, 3);
  EXPECT_LE(most_against, 0.02);
  EXPECT_GE(least_close, 0.9);
}

TEST(ThumbnailFit, WhatIsMissingOnEitherSideSpeaksAgainst) {
  Views views;
  const ThumbnailAligner aligner(views.camera);
  const tests::AnalyticScene room = tests::test_room();
  tests::AnalyticScene more = room;
  Pose X = Pose::Identity();
  X.translation() = Vec3(1.4, 0, 0.4);
  more.boxes.push_back({X, Vec3(0.3, 0.3, 0.4)});
  const auto against = [&](const tests::AnalyticScene& kept_scene,
                           const tests::AnalyticScene& seen_scene) {
    const Thumbnail kept = make_thumbnail(views.see(kept_scene, from(-0.2, 0.1)), {});
    CellView seen;
    fill_cell_view(views.see(seen_scene, from(-0.1, 0.05)), seen);
    return aligner.align(seen, kept, Pose::Identity()).against;
  };
  EXPECT_LE(against(room, room), 0.01);
  EXPECT_LE(against(more, more), 0.01);
  EXPECT_GE(against(room, more), 0.04);
  EXPECT_GE(against(more, room), 0.04);
}

TEST(ThumbnailFit, NothingSeenFitsNowhere) {
  Views views;
  const ThumbnailAligner aligner(views.camera);
  const Thumbnail kept = make_thumbnail(views.see(tests::test_room(), from(0, 0)), {});
  CellView seen;
  fill_cell_view(views.see({}, from(0, 0)), seen);
  const ThumbnailFit nothing = aligner.align(seen, kept, Pose::Identity());
  EXPECT_EQ(nothing.overlap, 0);
  EXPECT_EQ(nothing.score(), 0);
  fill_cell_view(views.see(tests::test_room(), from(0, 0)), seen);
  EXPECT_EQ(aligner.align(seen, {}, Pose::Identity()).score(), 0);
  EXPECT_TRUE(aligner.align(seen, kept, Pose::Identity()).X_KS.matrix().allFinite());
}

TEST(Thumbnail, DepthOfACodeIsItsInverse) {
  EXPECT_EQ(thumbnail_depth(0), 0);
  EXPECT_DOUBLE_EQ(thumbnail_depth(1), 0.3);
  for (int c = 2; c <= 255; ++c) {
    EXPECT_NEAR(thumbnail_depth(static_cast<std::uint8_t>(c)) /
                    thumbnail_depth(static_cast<std::uint8_t>(c - 1)),
                1.012, 1e-9);
  }
}

}  // namespace
}  // namespace perception
