// The whole stack on the recorded kitchen: every image tracked, and a hand that presses at image
// points of what was fused meets it with the force of a spring. Skipped where the recording is not.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tests/unit/tasks_fusion/recording.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/support/rt_guard.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/scene/box_devices.hpp"

namespace {

TEST(Recording, IsTrackedAndTouched) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording at " << tests::recording_folder();
  rt::Startup startup;
  auto scene = teletact::load_scene(teletact::find_config("scenes", "recording"), {});
  scene->rgbd_dir = tests::recording_folder();
  teletact::DemoOptions options;
  options.rgbd_dir = scene->rgbd_dir;
  options.virtual_clock = options.quiet = true;
  options.seconds = teletact::recording_seconds(scene->rgbd_dir) + scene->hold_s + 0.5;
  const auto run =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  teletact::RunInfo info;
  info.virtual_clock = info.recording = true;
  info.recorded = teletact::recording_figures(scene->rgbd_dir, run.op.view.fusion);
  teletact::Metrics metrics("test");
  teletact::add_metrics(info, run.op, run.robot, metrics);
  const auto value = [&](const char* name) {
    for (const auto& row : metrics.rows()) {
      if (row.name == name) return row.value;
    }
    ADD_FAILURE() << "no metric " << name;
    return std::nan("");
  };
  for (const char* name :
       {"fusion.frames_tracked", "fusion.ate_first_pose_mm", "haptic.contact_share",
        "haptic.contacts", "haptic.force_error_p95", "haptic.force_samples", "haptic.force_max_N",
        "haptic.force_step_raw_max_N", "haptic.force_step_max_N", "haptic.guard_share"}) {
    std::printf("%s %.4g\n", name, value(name));
  }
  EXPECT_EQ(value("fusion.frames"), 150);
  EXPECT_EQ(value("fusion.frames_tracked"), 150);
  EXPECT_LE(value("fusion.ate_first_pose_mm"), 40);
  EXPECT_GE(value("haptic.contact_share"), 0.4);
  EXPECT_GE(value("haptic.contacts"), 5);
  EXPECT_GE(value("haptic.force_samples"), 200) << "planes pressed on";
  EXPECT_LE(value("haptic.force_error_p95"), 0.10);
  EXPECT_LE(value("haptic.force_max_N"), 12);
  EXPECT_EQ(value("haptic.not_finite"), 0);
  EXPECT_LE(value("haptic.guard_share"), 0.06);
}

}  // namespace
