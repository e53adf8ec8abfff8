// The fusion task behind one call a frame, fed with rendered depth.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "rt/memory/section.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {

inline constexpr double kDt = 1.0 / 30;
inline constexpr double kWrong_m = 0.05;  // claimed and farther off than this: silently wrong

inline tasks::FusionConfig coarse() {
  tasks::FusionConfig c;
  c.tsdf.voxel_size_m = 0.02;
  c.tsdf.max_blocks = 8192;
  c.tsdf.max_chunks = 1024;
  c.patch_nodes = 32;
  return c;
}

struct Rig {
  rt::Startup startup;
  tasks::FusionSetup setup;
  std::unique_ptr<tasks::FusionTask> task;
  std::unique_ptr<perception::RgbdFrame> frame = std::make_unique<perception::RgbdFrame>();
  std::unique_ptr<perception::SurfacePatch> patch = std::make_unique<perception::SurfacePatch>();
  std::unique_ptr<tasks::SceneView> view = std::make_unique<tasks::SceneView>();
  std::unique_ptr<perception::CostMap> cost = std::make_unique<perception::CostMap>();
  rt::Random random{1};
  std::uint64_t period = 0;
  tasks::FusionTask::In in;
  tasks::FusionTask::Out out;
  rt::Health health;
  bool in_parts = false;  // a step in two parts; `first` is what the first one has written
  struct {
    bool patch, cost_map, camera, view;
  } first{};

  explicit Rig(const tasks::FusionConfig& config = coarse(), const Pose& X_WC0 = eye(0),
               const Intrinsics& camera = small_camera()) {
    setup.camera = camera;
    setup.X_WC0 = X_WC0;
    setup.ground.up_known = true;
    task = std::make_unique<tasks::FusionTask>(startup.token(), config, setup);
  }
  static Pose eye(int i) {
    return look_at(Vec3(-0.2 + 0.008 * i, 0.1 - 0.004 * i, 0.9), Vec3(1.8, -0.05, 0.3));
  }
  void step(bool fresh, int level = 0) {
    in.frame = frame.get();
    in.frame_fresh = fresh;
    out.patch = patch.get();
    out.view = view.get();
    out.cost_map = cost.get();
    rt::Tick tick;
    tick.k = period;
    tick.release = tick.start = rt::Time{rt::nanos_from_seconds(static_cast<double>(period) * kDt)};
    tick.level = level;
    ++period;
    rt_guard::reset();
    {
      rt::Section section;
      if (in_parts) {
        health = task->begin_step(tick, in, out);
        first = {out.patch_written, out.cost_map_written, out.camera_written, out.view_written};
        task->end_step(tick, in, out);
      } else {
        health = task->step(tick, in, out);
      }
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  void see(const AnalyticScene& scene, const Pose& X_WC, double sigma = 0.001, int level = 0) {
    fill_frame(scene, setup.camera, X_WC, sigma, random, *frame);
    frame->exposure = rt::Time{rt::nanos_from_seconds(static_cast<double>(period) * kDt - 0.02)};
    ++frame->seq;
    step(true, level);
  }
};

}  // namespace tests
