// The real recording through the task: every frame tracked, error bounded, CPU of each stage
// printed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "drivers/camera/tum_reader.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/quantile.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tasks {
namespace {

struct Playback {
  std::vector<Pose> poses, truth;
  int claimed = 0, tracked = 0;
  double worst_condition = 0, worst_residual_mm = 0, least_share = 1;
  std::uint64_t hash = 0;
  std::array<std::vector<double>, 9> stage_ms;  // as Profile, then the frame without the view
};

Playback run(const FusionConfig& config, int level, bool small, int frames) {
  rt::Startup startup;
  drivers::TumOptions options;
  options.to_512x424 = small;
  auto opened = drivers::TumSequence::open(tests::recording_folder(), options);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error());
  const drivers::TumSequence& sequence = opened.value();
  FusionSetup setup;
  setup.camera = sequence.intrinsics();
  FusionTask task(startup.token(), config, setup);
  task.profile(true);
  auto frame = std::make_unique<perception::RgbdFrame>();
  auto patch = std::make_unique<perception::SurfacePatch>();
  auto view = std::make_unique<SceneView>();
  auto cost = std::make_unique<perception::CostMap>();
  const auto truth = tests::recorded_poses();
  Playback result;
  rt::Hash64 hash;
  for (int i = 0; i < std::min(frames, sequence.size()); ++i) {
    EXPECT_TRUE(sequence.read(i, *frame));
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(i);
    tick.start = tick.release = frame->exposure;
    tick.level = level;
    FusionTask::In in;
    in.frame = frame.get();
    in.frame_fresh = true;
    in.hand.seq = 1;
    in.hand.p_WH = Vec3(0, 0, 1.5);
    FusionTask::Out out;
    out.patch = patch.get();
    out.view = view.get();
    out.cost_map = cost.get();
    rt_guard::reset();
    {
      rt::Section section;
      static_cast<void>(task.step(tick, in, out));
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U) << "frame " << i;
    EXPECT_TRUE(out.patch_written);
    result.claimed += out.camera.claimed ? 1 : 0;
    result.tracked += out.camera.tracking != CameraPose::Tracking::kLost ? 1 : 0;
    result.poses.push_back(out.camera.X_WC);
    result.truth.push_back(truth[static_cast<std::size_t>(i)]);
    if (i > 0) {
      result.worst_condition = std::max(result.worst_condition, out.tracking.condition);
      result.worst_residual_mm = std::max(result.worst_residual_mm, 1000 * out.tracking.residual_m);
      result.least_share = std::min(result.least_share, out.tracking.on_surface);
    }
    hash.word(patch->checksum);
    hash.bytes(out.camera.X_WC.data(), 16 * sizeof(double));
    hash.word(out.work);
    if (i >= 10) {
      const auto& p = task.last_profile();
      const std::int64_t ns[8] = {p.prepare, p.track,    p.integrate, p.raycast,
                                  p.ground,  p.cost_map, p.patch,     p.view};
      double sum = 0;
      for (std::size_t s = 0; s < 8; ++s) {
        const double ms = 1e-6 * static_cast<double>(ns[s]);
        if (s < 7) sum += ms;
        if (ns[s] > 0) result.stage_ms[s].push_back(ms);
      }
      result.stage_ms[8].push_back(sum);
    }
  }
  result.hash = hash.digest();
  std::printf("  ground found %d, blocks %d\n", task.ground().found(), task.map().block_count());
  return result;
}

void print(const char* name, const Playback& r) {
  const char* stages[] = {"prepare",  "track", "integrate", "raycast", "ground",
                          "cost_map", "patch", "view",      "frame"};
  const tests::PoseError e = tests::first_pose_error(r.poses, r.truth);
  std::printf(
      "%s: tracked %d claimed %d of %zu, ATE first pose %.1f mm (worst %.1f), condition <= %.0f, "
      "residual <= %.1f mm, on the surface >= %.2f\n  CPU ms p50 (p95):",
      name, r.tracked, r.claimed, r.poses.size(), e.rms_mm, e.worst_mm, r.worst_condition,
      r.worst_residual_mm, r.least_share);
  for (std::size_t s = 0; s < 9; ++s) {
    std::printf(" %s %.2f (%.2f)", stages[s], rt::quantile(r.stage_ms[s], 0.5),
                rt::quantile(r.stage_ms[s], 0.95));
  }
  std::printf("\n");
}

TEST(Recording, EveryFrameTrackedWithinTheBound) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  struct Case {
    const char* name;
    double voxel_m;
    int level;
    double wrong_mm;  // see test_recording_order.cpp
  };
  for (const Case& c :
       {Case{"512x424, 10 mm, step 1", 0.01, 0, 60}, Case{"512x424, 20 mm, step 2", 0.02, 1, 60},
        Case{"512x424, 20 mm, step 4", 0.02, 2, 60}}) {
    FusionConfig config;
    config.tsdf.voxel_size_m = c.voxel_m;
    const Playback r = run(config, c.level, true, 150);
    print(c.name, r);
    EXPECT_EQ(r.tracked, 150) << c.name;
    EXPECT_EQ(r.claimed, 150) << c.name;
    const tests::PoseError e = tests::first_pose_error(r.poses, r.truth);
    EXPECT_LE(e.rms_mm, 40.0) << c.name;
    EXPECT_LE(e.worst_mm, c.wrong_mm) << c.name << ": claimed, so farther off is silently wrong";
  }
}

// The first frames are the hardest: the fewer readings a voxel has and the smaller it is, the more
// its normals scatter.
TEST(Recording, EveryVoxelAndLevelTracksTheFirstFrames) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  for (const double voxel_m : {0.005, 0.007, 0.01, 0.013, 0.02, 0.04}) {
    for (const int level : {0, 2}) {
      FusionConfig config;
      config.tsdf.voxel_size_m = voxel_m;
      config.tsdf.max_blocks *= 4;
      const Playback r = run(config, level, true, 20);
      EXPECT_EQ(r.claimed, 20) << voxel_m << " m, level " << level;
      EXPECT_GT(r.least_share, config.tracker.weak_inlier_share)
          << voxel_m << " m, level " << level;
    }
  }
}

// Stage costs of the other variants, on the first seconds.
TEST(Recording, CostOfTheVariants) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  struct Case {
    const char* name;
    double voxel_m;
    int level;
    bool small;
  };
  for (const Case& c : {Case{"512x424, 10 mm, step 2", 0.01, 1, true},
                        Case{"512x424, 20 mm, step 1", 0.02, 0, true},
                        Case{"640x480, 10 mm, step 1", 0.01, 0, false}}) {
    FusionConfig config;
    config.tsdf.voxel_size_m = c.voxel_m;
    const Playback r = run(config, c.level, c.small, 40);
    print(c.name, r);
    EXPECT_EQ(r.tracked, 40) << c.name;
  }
}

TEST(Recording, TwoRunsGiveTheSameBytes) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  EXPECT_EQ(run(FusionConfig{}, 1, true, 25).hash, run(FusionConfig{}, 1, true, 25).hash);
}

}  // namespace
}  // namespace tasks
