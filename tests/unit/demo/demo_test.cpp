// The whole stack on the virtual clock: the same run twice is the same to the last bit, and the
// scene, not the program, decides what happens.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>

#include "tests/support/whole.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/run_truth.hpp"
#include "tools/measure/support/rt_guard.hpp"
#include "tools/scene/box_devices.hpp"

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

// One run of the default scene serves several tests; what the guard saw in it another.
struct Guarded {
  VirtualRun run;
  rt_guard::Counts counts;
};
const Guarded& guarded_run() {
  static const Guarded g = [] {
    rt_guard::reset();
    Guarded out{run(16), {}};
    out.counts = rt_guard::counts();
    return out;
  }();
  return g;
}
const VirtualRun& default_run() { return guarded_run().run; }
// Its first seconds, for those that run them in another way.
const VirtualRun& three_seconds() {
  static const VirtualRun r = run(3);
  return r;
}

// Figure 8: the default demo against the analytic world.
TEST(Demo, MarkBecomesAPathAndTheRobotDrivesIt) {
  const auto& r = default_run();
  EXPECT_GE(value(r, "mark.count"), 1);
  EXPECT_GE(value(r, "plan.paths"), 1);
  // Against the analytic world, by wheels that slip: the camera's pose drives.
  EXPECT_LE(value(r, "robot.goal_error_m"), 0.03);
  EXPECT_LE(value(r, "robot.arrival_error_max_m"), 0.03);
  EXPECT_EQ(value(r, "robot.arrivals"), 1);
  EXPECT_EQ(value(r, "robot.unsure_s"), 0);
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  const auto tracked = teletact::rendered_figures(*scene, r.op, r.robot);
  EXPECT_GT(tracked.ate_first_pose_mm, 0);
  EXPECT_LT(tracked.ate_first_pose_mm, 10);
  // The mark lies nearer to the pedestal than the base may stand: the goal is moved away from it,
  // no further.
  EXPECT_LE(value(r, "robot.mark_error_m"), 0.20);
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
  const VirtualRun& a = three_seconds();
  const VirtualRun b = run(3);
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

// Held back to the real clock: the same bytes, and not sooner.
TEST(Demo, APacedRunHasTheBytesOfAnUnpacedOne) {
  DemoOptions options;
  options.paced = true;
  const std::int64_t began = rt::monotonic_ns();
  const VirtualRun paced = run(3, {}, options);
  EXPECT_GE(1e-9 * static_cast<double>(rt::monotonic_ns() - began), 3.0);
  EXPECT_GE(paced.wall_s, 2.999);
  EXPECT_GE(paced.lag_s, 0);
  const VirtualRun& free = three_seconds();
  EXPECT_EQ(paced.sched_hash, free.sched_hash);
  EXPECT_EQ(paced.log_hash, free.log_hash);
}

// The lowest bit of one voxel of the fused map, inside the window of the hand, between two jobs.
void flip_a_voxel(teletact::OperatorBox& box, const perception::Vec3& near_W) {
  const perception::TsdfMap& map = box.graph().fusion().map();
  double nearest = 0.3;  // half a window and less
  std::uint32_t* word = nullptr;
  map.for_each_block([&](std::int32_t block, const perception::BlockCoord& at) {
    for (int n = 0; n < perception::TsdfMap::kBlockVoxels; ++n) {
      const perception::Vec3 node(8 * at.x + (n >> 6), 8 * at.y + (n >> 3 & 7), 8 * at.z + (n & 7));
      const double d = (map.voxel_size() * node - near_W).norm();
      const std::uint32_t* w = map.block_words(block) + n;
      if (d >= nearest || map.word_weight(*w) < 10 * perception::TsdfMap::kWeightOne) continue;
      nearest = d;
      word = const_cast<std::uint32_t*>(w);  // the map is ours; only its face to readers is const
    }
  });
  ASSERT_NE(word, nullptr) << "no voxel near the hand";
  *word ^= 1U;
}

TEST(Demo, OneBitOfOneVoxelChangesTheLog) {
  DemoOptions options;
  options.meddle_at_s = 2.51;
  options.meddle = [](teletact::OperatorBox&) {};
  const VirtualRun untouched = run(3, {}, options);
  ASSERT_GT(untouched.op.view.haptic.size(), 2500U);
  const auto& p = untouched.op.view.haptic[2500].p_WH;
  const perception::Vec3 hand_W(static_cast<double>(p[0]), static_cast<double>(p[1]),
                                static_cast<double>(p[2]));
  options.meddle = [&](teletact::OperatorBox& box) { flip_a_voxel(box, hand_W); };
  const VirtualRun flipped = run(3, {}, options);
  EXPECT_EQ(untouched.log_hash, three_seconds().log_hash) << "to look changes nothing";
  EXPECT_EQ(untouched.sched_hash, flipped.sched_hash);
  EXPECT_NE(untouched.log_hash, flipped.log_hash);
  // The first job whose output differs is the patch's writer, right after.
  const auto& a = untouched.op.log.tasks;
  const auto& b = flipped.op.log.tasks;
  std::int64_t first = INT64_MAX;
  std::string who;
  for (std::size_t t = 0; t < a.size(); ++t) {
    ASSERT_EQ(a[t].jobs.size(), b[t].jobs.size());
    for (std::size_t i = 0; i < a[t].jobs.size(); ++i) {
      if (a[t].jobs[i].output_hash == b[t].jobs[i].output_hash || a[t].jobs[i].end_ns >= first)
        continue;
      first = a[t].jobs[i].end_ns;
      who = a[t].spec.name;
    }
  }
  EXPECT_EQ(who, "fusion");
  EXPECT_LT(1e-9 * static_cast<double>(first - untouched.op.epoch_ns), 2.51 + 0.1);
}

TEST(Demo, StubBodiesGiveTheScheduleOfRealOnes) {
  DemoOptions stub;
  stub.stub_bodies = true;
  EXPECT_EQ(run(3, {}, stub).sched_hash, three_seconds().sched_hash);
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

// A cable that is cut tells nobody: both boxes are safe 300 ms later by the silence alone.
TEST(Demo, CuttingTheLinkStopsTheRobotAndLimpsTheHand) {
  DemoOptions options;
  // The robot drives at full speed; the hand presses.
  for (const double cut_s : tests::whole_or<double>({6.6, 6.95, 7.0}, {1})) {
    options.cut_link_at_s = cut_s;
    const VirtualRun r = run(cut_s + 1.5, {}, options);
    const auto after_ms = [&](std::int64_t stamp_ns, std::int64_t epoch_ns) {
      return 1e-6 * static_cast<double>(stamp_ns - epoch_ns) - 1e3 * cut_s;
    };
    double speed = 0, stands_ms = 0, force = 0, limp_ms = 0;
    for (const auto& s : r.robot.view.robot) {
      const double ms = after_ms(rt::ns_of(s.stamp), r.robot.epoch_ns);
      const auto v = static_cast<double>(s.speed_m_per_s);
      if (ms <= 0) speed = v;
      if (ms > 0 && v > 0.01) stands_ms = ms;
    }
    for (const auto& s : r.op.view.haptic) {
      const double ms = after_ms(rt::ns_of(s.stamp), r.op.epoch_ns);
      if (ms <= 0) force = static_cast<double>(s.force_N);
      if (ms > 0 && s.force_N > 0.0F) limp_ms = ms;
    }
    std::printf("cut at %.2f s: %.2f m/s and %.1f N; stands after %.0f ms, limp after %.0f ms\n",
                cut_s, speed, force, stands_ms, limp_ms);
    EXPECT_GT(speed, 0.2) << "it was driving";
    EXPECT_GT(stands_ms, 0);
    EXPECT_LE(stands_ms, 300);
    EXPECT_LE(limp_ms, 300);
    EXPECT_EQ(r.robot.view.mode.mode, tasks::Mode::kHold);
    EXPECT_NE(r.op.view.mode.mode, tasks::Mode::kEngaged);
  }
}

// A plan that stalls the robot's bus beyond its motors' watchdog at the k-th tick.
DemoOptions stalled(int k) {
  const std::string plan = testing::TempDir() + "teletact-stall-" + std::to_string(k) + ".toml";
  std::ofstream(plan) << "name = \"stall\"\nseed = 1\n[[fault]]\nkind = \"late_release\"\n"
                      << "target = \"robot_io\"\nfirst = " << k
                      << "\ncount = 1\nmagnitude_us = 150000\n";
  DemoOptions options;
  options.fault_plan = plan;
  return options;
}

struct SafeStop {
  double stopped_s = 0, again_s = 0;  // begins; engaged again
  double speed_until_again = 0, speed_after = 0;
};

SafeStop safe_stop_of(const VirtualRun& r) {
  SafeStop out;
  for (const auto& s : r.robot.view.robot) {
    const double t = 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.robot.epoch_ns);
    const auto mode = static_cast<tasks::Mode>(s.mode);
    if (mode == tasks::Mode::kSafeStop && out.stopped_s == 0) out.stopped_s = t;
    if (out.stopped_s == 0) continue;
    if (mode == tasks::Mode::kEngaged && out.again_s == 0) out.again_s = t;
    double& fastest = out.again_s == 0 ? out.speed_until_again : out.speed_after;
    if (t > out.stopped_s + 0.3) fastest = std::max<double>(fastest, s.speed_m_per_s);
  }
  std::printf("safe stop at %.2f s, engaged again at %.2f s\n", out.stopped_s, out.again_s);
  return out;
}

// A safe stop of both boxes, which no timeout ends but the operator: clear, then engage. A mark
// that he makes after it is driven to.
TEST(Demo, ASafeStopOfTheRobotIsClearedByTheOperatorAndTheRunGoesOn) {
  const DemoOptions options = stalled(1300);
  const VirtualRun r = run(18, {}, options);
  const SafeStop s = safe_stop_of(r);
  EXPECT_NEAR(s.stopped_s, 1.45, 0.1);
  EXPECT_GT(s.again_s, s.stopped_s + 1.0) << "the operator takes his time";
  EXPECT_LT(s.speed_until_again, 0.01);
  EXPECT_GT(s.speed_after, 0.2);
  EXPECT_EQ(value(r, "operator.clears"), 1);
  EXPECT_EQ(value(r, "operator.engages"), 2);
  EXPECT_LE(value(r, "robot.goal_error_m"), 0.10);
  EXPECT_EQ(value(r, "robot.collisions"), 0);
  std::remove(options.fault_plan.c_str());
}

// A stop on the way forgets the goal: engaged again, the base does not set off by itself. Without
// the operator's acts it stays in its safe stop.
TEST(Demo, ASafeStopForgetsTheGoal) {
  const DemoOptions options = stalled(6500);
  const VirtualRun r = run(12, {}, options);
  const SafeStop s = safe_stop_of(r);
  EXPECT_NEAR(s.stopped_s, 6.65, 0.1);
  EXPECT_GT(s.again_s, s.stopped_s + 1.0);
  EXPECT_LT(std::max(s.speed_until_again, s.speed_after), 0.01);

  const VirtualRun stays = run(12, {"operator.re_engage_after_s=0"}, options);
  EXPECT_EQ(stays.robot.view.mode.mode, tasks::Mode::kSafeStop) << "without the act nothing moves";
  EXPECT_EQ(value(stays, "operator.clears"), 0);
  std::remove(options.fault_plan.c_str());
}

// What the keys say about 300 ms is checked when a scene is read.
TEST(Demo, AScenesKeysMustLeaveTheBoxesSafeInTime) {
  const std::string path = teletact::find_config("scenes", "default_room");
  const auto refusal = [&](const std::vector<std::string>& overrides) -> std::string {
    try {
      (void)teletact::load_scene(path, overrides);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return {};
  };
  // 90 + 2 + v / 4 + 70 ms: 0.552 m/s is the fastest; 180 + 10 + 1 + r: 109 ms the longest ramp.
  EXPECT_EQ(refusal({"robot_io.trajectory.speed_m_per_s=0.551"}), "");
  EXPECT_EQ(refusal({"haptic.ramp_s=0.109"}), "");
  for (const auto& [key, said] : std::vector<std::pair<std::string, std::string>>{
           {"robot_io.trajectory.speed_m_per_s=0.56", "302 ms"},
           {"robot_io.trajectory.ramp_down_deceleration_m_per_s2=3", "329 ms"},
           {"robot_io.link_silence_ms=120", "317 ms"},
           {"robot_io.motor_settle_s=0.1", "317 ms"},
           {"supervision.link_liveness_s=0.2", "311 ms"},
           {"haptic.ramp_s=0.12", "311 ms"},
           {"haptic.slew_N_per_s=100", "311 ms"}}) {
    const std::string what = refusal({key});
    EXPECT_NE(what.find(said), std::string::npos) << key << ": " << what;
    EXPECT_NE(what.find(key.substr(0, key.find('='))), std::string::npos) << what;
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
    EXPECT_EQ(what.rfind(path, 0), 0U) << "names the file: " << what;
  }
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

TEST(Demo, EveryEffectThatAKeyCallsForIsListedWithItsKey) {
  static rt::Startup startup;
  const std::vector<std::pair<std::string, std::string>> keys{
      {"haptic.friction_static", "0.5"},     {"haptic.texture_amplitude_m", "0.0002"},
      {"haptic.viscosity_N_s_per_m", "1"},   {"haptic.materials", "true"},
      {"fusion.objects.enabled", "true"},    {"fusion.mesh_blocks", "100"},
      {"haptic.method", "\"force_shading\""}};
  std::vector<std::string> overrides;
  for (const auto& [key, set_to] : keys) overrides.push_back(key + "=" + set_to);
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "empty_room"), overrides);
  DemoOptions options;
  options.seconds = 0.2;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  const VirtualRun run =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  EXPECT_EQ(run.effects.size(), keys.size());
  for (const auto& [key, set_to] : keys) {
    EXPECT_TRUE(std::any_of(run.effects.begin(), run.effects.end(), [&](const auto& e) {
      return e.second == key;
    })) << key;
  }
}

TEST(Demo, AnArmIsAnEffectOfTheSceneThatNamesOne) {
  static rt::Startup startup;
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "arm"),
                           {"robot.arm.joint_delay_ms=20", "robot.arm.joint_error_deg=0.5"});
  DemoOptions options;
  options.seconds = 0.2;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  const VirtualRun arm =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  // The default scene without what its wheels do.
  const auto& plain = default_run().effects;
  const auto wheels = std::count_if(plain.begin(), plain.end(), [](const auto& e) {
    return e.first == "robot: wheel_slip" || e.first == "robot: wheel_radius" ||
           e.first == "robot: encoder_quantisation";
  });
  EXPECT_EQ(wheels, 3);
  EXPECT_EQ(arm.effects.size(), plain.size() - 3 + 3);
  EXPECT_EQ(std::count_if(arm.effects.begin(), arm.effects.end(),
                          [](const auto& e) { return e.second == "robot.arm"; }),
            3);
  // What it can not do stops before the start, with one line.
  const std::string path = teletact::find_config("scenes", "arm");
  const auto refusal = [](const std::string& file, const std::string& key) -> std::string {
    try {
      (void)teletact::load_scene(file, {key});
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return {};
  };
  EXPECT_NE(refusal(path, "robot.arm.key=[{time_s=1}]").find("robot.arm.key[5].time_s"),
            std::string::npos)
      << refusal(path, "robot.arm.key=[{time_s=1}]");
  EXPECT_NE(refusal(path, "robot.arm.description=\"nobody\"").find("nobody"), std::string::npos);
  EXPECT_NE(refusal(teletact::find_config("scenes", "empty_room"), "robot.arm.joint_delay_ms=5")
                .find("robot.arm.key"),
            std::string::npos);
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
  const auto& c = guarded_run().counts;
  EXPECT_EQ(c.allocations, 0U);
  EXPECT_EQ(c.frees, 0U);
  EXPECT_EQ(c.locks, 0U);
  EXPECT_EQ(c.throws, 0U);
}

}  // namespace
