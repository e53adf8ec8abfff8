// The published method of touch, live: a scene that asks for it gets fusion's ray cast, and what
// the hand feels of the default scene is a surface.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "rt/effect_count.hpp"
#include "rt/quantile.hpp"
#include "tasks/supervision/fault_ids.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using teletact::DemoOptions;
using teletact::VirtualRun;

constexpr const char* kMethod = "haptic.method=\"force_shading\"";

VirtualRun run(double seconds, const std::vector<std::string>& overrides, int cores = 2) {
  static rt::Startup startup;
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = cores;
  return teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
}

// Floor, flat top and side of the pedestal: all that the script touches.
const VirtualRun& touched() {
  rt_guard::reset();
  static const VirtualRun r = run(13, {kMethod});
  return r;
}

TEST(ForceShadingLive, TheSceneIsTouchedWithTheForceOfASpring) {
  const VirtualRun& r = touched();
  if (rt_guard::linked()) {
    EXPECT_EQ(rt_guard::counts().total(), 0U) << "fusion's cast and haptic's ticks are hard";
  }
  int contacts = 0;
  bool before = false;
  for (const auto& s : r.op.view.haptic) {
    ASSERT_TRUE(s.finite);
    ASSERT_LE(s.force_N, 12.0F);
    contacts += s.in_contact && !before ? 1 : 0;
    before = s.in_contact;
  }
  EXPECT_GE(contacts, 3) << "floor, top, side";
  // Against the map's own zero set, wherever the hand rests on a plane.
  std::printf("  %d contacts; %zu samples on planes, p95 of the force's error %.3f\n", contacts,
              r.op.force_check.samples, r.op.force_check.relative_error_p95);
  EXPECT_GT(r.op.force_check.samples, 300U);
  EXPECT_LE(r.op.force_check.relative_error_p95, 0.10);
}

// The floor lies at 0 m, and the hand presses on it and slides where the camera sees it. (The
// pedestal's top is out of view when it is touched: the nearest point of the cast is then
// elsewhere, which is the method's own.) The method takes the nearest of the cast's points, whose
// heights scatter by millimetres at 20 mm voxels (2.7 and 0.05 mm here, one after the other): the
// force is the spring's from where that point is, and the point no more than 4 mm off the floor.
TEST(ForceShadingLive, OnAFlatFaceInViewTheForceIsStiffnessTimesDepth) {
  const VirtualRun& r = touched();
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  const auto& haptic = scene->graph.haptic;
  const double N_per_m = haptic.stiffness_N_per_m / haptic.scale;
  std::vector<double> off_m;
  double least_m = 1, most_m = 0, least_off_m = 1, most_off_m = -1;  // while the first point holds
  perception::Vec3f first = perception::Vec3f::Zero();
  for (const auto& s : r.op.view.haptic) {
    if (!s.in_contact || s.gain < 1 || s.guard_active) continue;
    const perception::Vec3f p(s.p_WP[0], s.p_WP[1], s.p_WP[2]);
    const double depth_m = -static_cast<double>(s.p_WH[2]);
    if ((p.head<2>() - Eigen::Vector2f(1.83F, -0.37F)).norm() > 0.1F || depth_m * N_per_m < 2)
      continue;
    const double off = static_cast<double>(s.force_N) / N_per_m - depth_m;
    if (off_m.empty()) first = p;
    if (off_m.size() < 250 && (p - first).head<2>().norm() < 0.002F) {
      least_m = std::min(least_m, depth_m), most_m = std::max(most_m, depth_m);
      least_off_m = std::min(least_off_m, off), most_off_m = std::max(most_off_m, off);
    }
    off_m.push_back(off);
  }
  ASSERT_GT(off_m.size(), 250U);
  for (double& off : off_m) off = std::abs(off);
  const double p95_m = rt::quantile(off_m, 0.95);
  std::printf(
      "  on the floor, %zu ticks: off K x depth by p50 %.2f, p95 %.2f mm; pressed from %.1f to "
      "%.1f mm by %.2f mm\n",
      off_m.size(), 1e3 * rt::quantile(off_m, 0.5), 1e3 * p95_m, 1e3 * least_m, 1e3 * most_m,
      1e3 * (most_off_m - least_off_m));
  EXPECT_LE(p95_m, 0.004);
  ASSERT_GT(most_m - least_m, 0.005);
  EXPECT_LE(most_off_m - least_off_m, 0.10 * (most_m - least_m)) << "the spring's own slope";
}

TEST(ForceShadingLive, TheRunNamesItsMethodAndItsEffect) {
  const VirtualRun& r = touched();
  EXPECT_THAT(r.effects, testing::Contains(std::pair<std::string, std::string>(
                             "touch: force shading", "haptic.method")));
  teletact::RunInfo info;
  info.touch_method = "force_shading";
  info.touch_N_per_m = 1000 / 5.5;
  teletact::Metrics metrics("demo");
  teletact::add_metrics(info, r.op, r.robot, metrics);
  std::string method;
  for (const auto& row : metrics.rows()) {
    if (row.name == "haptic.method") method = row.text;
  }
  EXPECT_EQ(method, "force_shading");
  EXPECT_THAT(teletact::make_report(info, r.op, r.robot, metrics).verdicts,
              testing::Contains(testing::Field(&teletact::ReportVerdict::text,
                                               testing::HasSubstr("method force_shading"))));
}

TEST(ForceShadingLive, TheSameRunTwiceIsTheSameToTheLastBit) {
  const VirtualRun a = run(4, {kMethod}), b = run(4, {kMethod}), other = run(4, {});
  EXPECT_EQ(a.sched_hash, b.sched_hash);
  EXPECT_EQ(a.log_hash, b.log_hash);
  EXPECT_NE(a.log_hash, other.log_hash);
}

// A scene that does not ask for it builds none and publishes none.
TEST(ForceShadingLive, WithoutTheMethodNothingOfItIsMade) {
  auto& count = rt::effect_counts[static_cast<std::size_t>(rt::Effect::kForceShading)];
  for (const char* method : {"constrained", "nearest", "nearest10"}) {
    count.built = count.ran = 0;
    const VirtualRun r = run(2, {"haptic.method=\"" + std::string(method) + "\""});
    EXPECT_EQ(count.built, 0U) << method;
    EXPECT_EQ(count.ran, 0U) << method;
    for (const auto& task : r.op.log.tasks) {
      if (task.spec.name != "haptic") continue;
      for (const auto& job : task.jobs) ASSERT_EQ(job.input_seq[4], 0U);
    }
  }
  const VirtualRun r = run(2, {kMethod});
  EXPECT_EQ(count.built, 1U);
  EXPECT_GE(count.ran, 3U) << "every twelve periods from the first claim on";
  EXPECT_LE(count.ran, 5U);
}

// On a host that has no room for it the refusal says what it adds.
TEST(ForceShadingLive, AHostWithoutRoomForItIsTold) {
  try {
    (void)run(1, {kMethod, "fusion.tsdf.voxel_size_m=0.02"}, 1);
    ADD_FAILURE() << "one core carries it";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr(
                              "haptic.method = \"force_shading\" adds 6.7 ms to a job of fusion"));
    EXPECT_THAT(e.what(), testing::Not(testing::HasSubstr("\n")));
  }
}

}  // namespace
