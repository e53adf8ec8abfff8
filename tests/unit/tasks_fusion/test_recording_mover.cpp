// The recording forwards and backwards with somebody who walks through it: put into depth by true
// order, in the place's own frame, with the noise of a Kinect v2, and into colour where they are in
// front. Beside the plain run of the same images.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <vector>

#include "drivers/camera/render.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "drivers/world/world.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::kDt;

constexpr double kCameraHeight_m =
    1.4;                   // over the floor that they walk on; the recording's own is not known
constexpr int kFrom = 30;  // images before anybody comes

struct Path {
  double at_m, speed_m_per_s;  // from the first camera; along the image
};

drivers::WorldConfig walker(const Path& path) {
  drivers::WorldConfig w;
  auto& body = w.cylinders.emplace_back();
  body.name = "body";
  body.position_m = {path.at_m, 2.0, 0};
  body.radius_m = 0.24;
  body.height_m = 1.51;
  body.paint.colour = {40, 60, 200};  // nothing of the kitchen is
  auto& head = w.spheres.emplace_back();
  head.name = "head";
  head.position_m = {path.at_m, 2.0, 1.63};
  head.radius_m = 0.12;
  head.paint.colour = {40, 60, 200};
  auto& walk = w.movers.emplace_back();
  walk.name = "walk";
  walk.shapes = "body, head";
  walk.kind = "walk";
  walk.speed_m_per_s = path.speed_m_per_s;
  for (int i = 0; i < 20; ++i) {
    walk.waypoints.emplace_back().offset_m = {0, -4.0, 0};
    walk.waypoints.emplace_back().offset_m = {0, 0, 0};
  }
  return w;
}

struct Played {
  std::vector<Pose> poses;
  std::vector<bool> claimed;
  double most_share = 0;                   // of the readings
  int with_colour = 0;                     // images
  std::int64_t shown = 0, recoloured = 0;  // pixels: put in; of them with a new colour
  double blue_before = 0, blue_after = 0;  // of the recoloured, mean of blue less red
};

Played play(double voxel_m, const Path* path) {
  rt::Startup startup;
  drivers::TumOptions options;
  options.to_512x424 = true;
  options.register_colour = true;  // as the program reads it
  auto opened = drivers::TumSequence::open(tests::recording_folder(), options);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error());
  FusionConfig config;
  config.tsdf.voxel_size_m = voxel_m;
  config.view_period_frames = 0;
  FusionSetup setup;
  setup.camera = opened.value().intrinsics();
  FusionTask task(startup.token(), config, setup);
  const auto truth = tests::recorded_poses();
  const auto at = [](int k) { return rt::Time{rt::nanos_from_seconds((k + 1) * kDt)}; };
  const drivers::World world(startup.token(), walker(path != nullptr ? *path : Path{2, 1}),
                             at(kFrom));
  const drivers::DepthNoise noise(startup.token(), {1.0, 0.3, 0.5, 0.02});
  drivers::RenderScratch scratch(startup.token(), world.shapes().size());
  scratch.shape.resize(perception::RgbdFrame::kMaxPixels);
  auto frame = std::make_unique<perception::RgbdFrame>();
  auto alone = std::make_unique<perception::RgbdFrame>();
  Pose X_TC0 = Pose::Identity();  // x forward, z up; the camera looks along z, its y goes down
  X_TC0.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  X_TC0.translation().z() = kCameraHeight_m;
  const int size = opened.value().size();
  Played run;
  for (int k = 0; k < 2 * size - 1; ++k) {
    const int i = k < size ? k : 2 * size - 2 - k;
    EXPECT_TRUE(opened.value().read(i, *frame));
    frame->exposure = at(k);
    run.with_colour += frame->has_colour ? 1 : 0;
    if (path != nullptr && k >= kFrom) {
      const Pose X_TC = X_TC0 * truth.front().inverse() * truth[static_cast<std::size_t>(i)];
      drivers::render(world, frame->intrinsics, X_TC, {0.4, 5.0}, noise, 1,
                      static_cast<std::uint64_t>(k), scratch, *alone, at(k));
      int shown = 0, readings = 0;
      for (std::size_t p = 0; p < static_cast<std::size_t>(frame->intrinsics.width) *
                                      static_cast<std::size_t>(frame->intrinsics.height);
           ++p) {
        readings += frame->depth_mm[p] != 0 ? 1 : 0;
        if (scratch.shape[p] < 0) continue;
        const float z_mm = 1e3F / scratch.inverse_m[p];
        if (frame->depth_mm[p] != 0 && static_cast<float>(frame->depth_mm[p]) <= z_mm) continue;
        frame->depth_mm[p] = alone->depth_mm[p];
        ++shown;
        // Exactly black: no colour there, or no surface (perception/geometry/no_colour.hpp).
        const auto black = [](const perception::Rgb& c) {
          return c.r == 0 && c.g == 0 && c.b == 0;
        };
        perception::Rgb& c = frame->colour[p];
        if (!frame->has_colour || black(alone->colour[p])) continue;
        ++run.recoloured;
        run.blue_before += c.b - c.r;
        c = alone->colour[p];
        run.blue_after += c.b - c.r;
      }
      run.shown += shown;
      run.most_share = std::max(run.most_share, static_cast<double>(shown) / std::max(1, readings));
    }
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(k);
    tick.start = tick.release = frame->exposure;
    FusionTask::In in;
    in.frame = frame.get();
    in.frame_fresh = true;
    FusionTask::Out out;
    static_cast<void>(task.step(tick, in, out));
    run.poses.push_back(out.camera.X_WC);
    run.claimed.push_back(out.camera.claimed);
  }
  run.blue_before /= static_cast<double>(std::max<std::int64_t>(1, run.recoloured));
  run.blue_after /= static_cast<double>(std::max<std::int64_t>(1, run.recoloured));
  return run;
}

TEST(RecordingMover, WhoWalksThroughMovesNoPose) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording: " << tests::recording_folder();
  const Played plain = play(0.02, nullptr);
  for (const Path path : {Path{2.0, 1.2}, Path{1.3, 0.6}}) {
    const Played with = play(0.02, &path);
    double worst_m = 0, sum = 0;
    int claimed = 0;
    for (std::size_t k = 0; k < with.poses.size(); ++k) {
      if (!with.claimed[k]) continue;
      ++claimed;
      const double off = (with.poses[k].translation() - plain.poses[k].translation()).norm();
      worst_m = std::max(worst_m, off);
      sum += off * off;
    }
    const double rms_m = std::sqrt(sum / std::max(1, claimed));
    std::printf(
        "  at %.1f m, %.1f m/s: at most %.2f of the image; claimed %d of %zu, %.1f mm RMS and %.1f "
        "mm from the plain run\n",
        path.at_m, path.speed_m_per_s, with.most_share, claimed, with.poses.size(), 1e3 * rms_m,
        1e3 * worst_m);
    std::printf("    colour of %.3f of what was put in, blue less red %.0f where it was %.0f\n",
                static_cast<double>(with.recoloured) / static_cast<double>(with.shown),
                with.blue_after, with.blue_before);
    EXPECT_EQ(with.with_colour, static_cast<int>(with.poses.size()));
    EXPECT_GE(static_cast<double>(with.recoloured), 0.95 * static_cast<double>(with.shown));
    EXPECT_GT(with.blue_after, with.blue_before + 50) << "they are of another colour";
    EXPECT_GT(with.most_share, 0.1);
    EXPECT_GE(claimed, 0.98 * static_cast<double>(with.poses.size()));
    EXPECT_LE(worst_m, 0.010);
    EXPECT_LE(rms_m, 0.003);
  }
}

}  // namespace
}  // namespace tasks
