// The recording's frames in another order: with gaps, after darkness, from elsewhere.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::kDt;

struct Show {
  int first, last, stride;
};

struct Result {
  int frames = 0, claimed = 0, wrong = 0, worst_wait = 0;
  double worst_mm = 0, ate_mm = 0;
};

// The recorded poses come from a KinectFusion themselves, good to about 2 cm a metre: one limit,
// whatever the voxels.
constexpr double kWrong_m = 0.06;
struct Voxels {
  double size_m, wrong_m;
};
constexpr Voxels kVoxels[] = {{0.01, kWrong_m}, {0.02, kWrong_m}};

// Frames of the recording in another order; -1 is a dark one. A wait counts from the first frame of
// a show.
Result play(const std::vector<int>& order, const Voxels& voxels) {
  rt::Startup startup;
  drivers::TumOptions options;
  options.to_512x424 = true;
  auto opened = drivers::TumSequence::open(tests::recording_folder(), options);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error());
  FusionConfig config;
  config.tsdf.voxel_size_m = voxels.size_m;
  config.view_period_frames = 0;
  FusionSetup setup;
  setup.camera = opened.value().intrinsics();
  FusionTask task(startup.token(), config, setup);
  const auto truth = tests::recorded_poses();
  auto frame = std::make_unique<perception::RgbdFrame>();
  Result r;
  double sum = 0;
  int wait = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const int i = order[k];
    if (i >= 0) {
      EXPECT_TRUE(opened.value().read(i, *frame));
    } else {
      frame->depth_mm.fill(0);
    }
    rt::Tick tick;
    tick.k = k;
    tick.start = tick.release = frame->exposure =
        rt::Time{rt::nanos_from_seconds(static_cast<double>(k + 1) * kDt)};
    FusionTask::In in;
    in.frame = frame.get();
    in.frame_fresh = true;
    FusionTask::Out out;
    static_cast<void>(task.step(tick, in, out));
    ++r.frames;
    wait = i < 0 ? 0 : wait + 1;
    r.worst_wait = std::max(r.worst_wait, wait);  // also of what is never claimed
    if (!out.camera_written || !out.camera.claimed) continue;
    wait = 0;
    ++r.claimed;
    const Pose X_true =
        truth[static_cast<std::size_t>(order[0])].inverse() * truth[static_cast<std::size_t>(i)];
    const double off = (out.camera.X_WC.translation() - X_true.translation()).norm();
    sum += off * off;
    r.worst_mm = std::max(r.worst_mm, 1000 * off);
    r.wrong += off > voxels.wrong_m ? 1 : 0;
  }
  r.ate_mm = 1000 * std::sqrt(sum / std::max(1, r.claimed));
  return r;
}

void print(const char* name, const Result& r) {
  std::printf("  %s: claimed %d of %d, longest wait %d, ATE %.1f mm, worst %.1f mm, wrong %d\n",
              name, r.claimed, r.frames, r.worst_wait, r.ate_mm, r.worst_mm, r.wrong);
}

void append(std::vector<int>& order, Show s) {
  for (int i = s.first; s.stride > 0 ? i <= s.last : i >= s.last; i += s.stride) order.push_back(i);
}

TEST(Relocalisation, RecordingByStrides) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  for (const Voxels& voxels : kVoxels) {
    for (const int stride : {2, 4, 8}) {
      std::vector<int> order;
      append(order, {0, 149, stride});
      const Result r = play(order, voxels);
      char name[48];
      std::snprintf(name, sizeof name, "%.0f mm, every %d. frame", 1000 * voxels.size_m, stride);
      print(name, r);
      EXPECT_LE(r.ate_mm, 40.0);
      if (stride <= 4) {  // every eighth may be lost, but not wrong
        EXPECT_EQ(r.claimed, r.frames);
      }
      EXPECT_EQ(r.wrong, 0);
    }
  }
}

TEST(Relocalisation, RecordingAfterDarknessAndKidnapping) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  std::vector<int> dark, kidnap;
  append(dark, {0, 79, 1});
  dark.insert(dark.end(), 30, -1);
  append(dark, {60, 30, -1});
  append(kidnap, {0, 119, 2});
  append(kidnap, {10, 26, 1});
  append(kidnap, {90, 74, -1});
  append(kidnap, {1, 17, 1});
  for (const Voxels& voxels : kVoxels) {
    for (const auto& [name, order] :
         {std::pair{"dark for 1 s, then 20 frames back", dark}, std::pair{"kidnapped", kidnap}}) {
      const Result r = play(order, voxels);
      std::printf("  %.0f mm", 1000 * voxels.size_m);
      print(name, r);
      EXPECT_LE(r.worst_wait, 15) << name;
      EXPECT_LE(r.ate_mm, 40.0) << name;
      EXPECT_EQ(r.wrong, 0) << name;
    }
  }
}

}  // namespace
}  // namespace tasks
