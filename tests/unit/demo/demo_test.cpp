// The whole stack on the virtual clock: the same run twice is the same to the last bit, and the
// scene, not the program, decides what happens.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/rt_guard.hpp"
#include "tools/teletact/calibrate.hpp"
#include "tools/teletact/run_demo.hpp"

namespace {

using teletact::DemoOptions;
using teletact::VirtualRun;

VirtualRun run(double seconds, const std::vector<std::string>& overrides = {},
               DemoOptions options = {}) {
  static rt::Startup startup;
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  return teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
}

double value(const VirtualRun& r, const std::string& name) {
  teletact::RunInfo info;
  info.virtual_clock = true;
  info.effects = r.effects;
  teletact::Metrics metrics("test");
  teletact::add_metrics(info, r.op, r.robot, metrics);
  for (const auto& row : metrics.rows()) {
    if (row.name == name) return row.value;
  }
  ADD_FAILURE() << "no metric " << name;
  return std::nan("");
}

// One run of the default scene serves several tests.
const VirtualRun& default_run() {
  static const VirtualRun r = run(16);
  return r;
}

// Figure 8: the default demo against the analytic world.
TEST(Demo, MarkBecomesAPathAndTheRobotDrivesIt) {
  const auto& r = default_run();
  EXPECT_GE(value(r, "mark.count"), 1);
  EXPECT_GE(value(r, "plan.paths"), 1);
  EXPECT_LE(value(r, "robot.goal_error_m"), 0.10);
  EXPECT_EQ(value(r, "robot.collisions"), 0);
  EXPECT_GE(value(r, "robot.path_m"), 1.5);
  EXPECT_LE(value(r, "robot.tracking_error_max_m"), 0.030);
  EXPECT_GT(value(r, "scene.touch_to_goal_ms"), 0);
}

TEST(Demo, TheHandFeelsTheFusedScene) {
  const auto& r = default_run();
  EXPECT_GE(value(r, "haptic.contacts"), 3);
  EXPECT_LE(value(r, "haptic.force_max_N"), 12.0);
  EXPECT_GE(value(r, "haptic.force_max_N"), 3.0);
  EXPECT_EQ(value(r, "haptic.not_finite"), 0);
  EXPECT_LE(value(r, "haptic.guard_share"), 0.06);
  EXPECT_EQ(value(r, "fusion.frames_tracked"), value(r, "fusion.frames"));
  EXPECT_GE(value(r, "fusion.frames"), 16 * 30 - 10);
}

TEST(Demo, NoDeadlineIsMissedWithTheCalibratedCosts) {
  const auto& r = default_run();
  EXPECT_EQ(value(r, "haptic.releases"), 16000);
  EXPECT_EQ(value(r, "haptic.completed"), 16000);
  EXPECT_EQ(value(r, "haptic.miss_total"), 0);
}

// Figure 2: equal hashes for equal input, other hashes for any other input.
TEST(Demo, TheSameRunTwiceIsTheSameToTheLastBit) {
  const VirtualRun a = run(3), b = run(3);
  EXPECT_EQ(a.sched_hash, b.sched_hash);
  EXPECT_EQ(a.log_hash, b.log_hash);
  const VirtualRun seed = run(3, {"camera.seed=2"});
  EXPECT_EQ(a.sched_hash, seed.sched_hash)
      << "the schedule does not depend on what the camera sees";
  EXPECT_NE(a.log_hash, seed.log_hash);
  const VirtualRun stiffness = run(4, {"haptic.stiffness_N_per_m=1000.0000001"});
  const VirtualRun plain = run(4);
  EXPECT_NE(plain.log_hash, stiffness.log_hash) << "a force bit";
  DemoOptions costs;
  costs.cost_seed = 2;
  EXPECT_NE(a.sched_hash, run(3, {}, costs).sched_hash);
}

TEST(Demo, StubBodiesGiveTheScheduleOfRealOnes) {
  DemoOptions stub;
  stub.stub_bodies = true;
  EXPECT_EQ(run(3, {}, stub).sched_hash, run(3).sched_hash);
}

// Metamorphic: what changes in the scene changes in the run, and nothing else does.
TEST(Demo, MovingTheBoxChangesThePath) {
  static rt::Startup startup;
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  ASSERT_EQ(scene->world.boxes.front().name, "hurdle");
  scene->world.boxes.front().position_m = {1.0, 0.75, 0.075};
  DemoOptions options;
  options.seconds = 8;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  const VirtualRun moved =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  ASSERT_FALSE(moved.op.view.paths.empty());
  ASSERT_FALSE(default_run().op.view.paths.empty());
  const auto& a = default_run().op.view.paths.front();
  const auto& b = moved.op.view.paths.front();
  double largest = 0;
  for (int i = 0; i < std::min(a.size, b.size); ++i) {
    const auto& p = a.points[static_cast<std::size_t>(i)];
    const auto& q = b.points[static_cast<std::size_t>(i)];
    largest = std::max(largest, std::hypot(p[0] - q[0], p[1] - q[1]));
  }
  EXPECT_GT(largest, 0.2) << "the way round the box is another one";
}

TEST(Demo, WithoutAMarkTheRobotStaysStill) {
  static rt::Startup startup;
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  for (auto& s : scene->hand.segments) {
    if (s.kind == "button_down") s.kind = "hold";
  }
  DemoOptions options;
  options.seconds = 9;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  const VirtualRun r =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  EXPECT_EQ(value(r, "mark.count"), 0);
  EXPECT_LT(value(r, "robot.path_m"), 1e-6);
  EXPECT_GE(value(r, "haptic.contacts"), 1) << "the hand still touches";
}

TEST(Demo, CuttingTheLinkStopsTheRobot) {
  DemoOptions options;
  options.cut_link_at_s = 7.0;
  const VirtualRun r = run(9, {}, options);
  const auto& truth = r.robot.view.truth;
  ASSERT_GT(truth.size(), 100U);
  const std::int64_t epoch = r.robot.epoch_ns;
  const auto path_at = [&](double t) {
    double path = 0;
    for (const auto& s : truth) {
      if (static_cast<double>(rt::ns_of(s.stamp) - epoch) * 1e-9 <= t) path = s.path_m;
    }
    return path;
  };
  EXPECT_GT(path_at(7.0), 0.3) << "it was driving";
  // 250 ms of silence, then a ramp of at most 0.5 s from 0.5 m/s.
  EXPECT_LT(path_at(9.0) - path_at(7.8), 1e-3) << "it stands";
  EXPECT_LT(path_at(7.8) - path_at(7.0), 0.35);
}

TEST(Demo, AnEffectThatNoKeyCallsForIsNotConstructed) {
  static rt::Startup startup;
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "empty_room"), {});
  DemoOptions options;
  options.seconds = 0.2;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  const VirtualRun bare =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  EXPECT_TRUE(bare.effects.empty()) << bare.effects.front().first;
  EXPECT_GE(default_run().effects.size(), 5U);
}

TEST(Demo, AnUnknownKeyOrABadValueStopsWithOneLine) {
  const std::string path = teletact::find_config("scenes", "default_room");
  for (const auto& [override_text, named] : std::vector<std::pair<std::string, std::string>>{
           {"haptic.stifness_N_per_m=900", "stifness_N_per_m"},
           {"fusion.tsdf.voxel_size_m=5", "voxel_size_m"}}) {
    try {
      (void)teletact::load_scene(path, {override_text});
      ADD_FAILURE() << override_text << " was taken";
    } catch (const std::runtime_error& e) {
      const std::string what = e.what();
      EXPECT_NE(what.find(named), std::string::npos) << what;
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
    }
  }
}

// Hard tasks: no allocation, lock or throw in any step of the run.
TEST(Demo, HardStepsNeverAllocateLockOrThrow) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked into this build";
  rt_guard::reset();
  (void)run(8);
  const auto c = rt_guard::counts();
  EXPECT_EQ(c.allocations, 0U);
  EXPECT_EQ(c.frees, 0U);
  EXPECT_EQ(c.locks, 0U);
  EXPECT_EQ(c.throws, 0U);
}

}  // namespace
