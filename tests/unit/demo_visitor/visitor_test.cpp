// Somebody walks into the robot's way (scene visitor), the whole stack on the virtual clock: the
// base waits or goes round, the hand feels what it feels without them, and nothing of them stays.
// And the robot's arm reaches before the camera (scene arm): mark, drive and touch are as without
// it.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <utility>

#include "perception/motion/motion_mask.hpp"
#include "tests/unit/demo_driving/drive.hpp"
#include "tools/box/finish_run.hpp"
#include "tools/host/script_goal.hpp"
#include "tools/scene/box_devices.hpp"

namespace tests {
namespace {

using perception::Pose;

constexpr double kSeconds = 20;

std::unique_ptr<Scene> visited(const std::vector<std::string>& overrides = {}) {
  return teletact::load_scene(teletact::find_config("scenes", "visitor"), overrides);
}

// Where the twin says that the robot was; straight on between two samples.
teletact::TruthSample truth_at(const VirtualRun& r, std::int64_t since_epoch_ns) {
  const auto& truth = r.robot.view.truth;
  const auto ns = [&](const teletact::TruthSample& s) {
    return rt::ns_of(s.stamp) - r.robot.epoch_ns;
  };
  auto b = std::lower_bound(truth.begin(), truth.end(), since_epoch_ns,
                            [&](const auto& s, std::int64_t t) { return ns(s) < t; });
  if (b == truth.begin()) return truth.front();
  if (b == truth.end()) return truth.back();
  const auto& a = *(b - 1);
  const double f =
      static_cast<double>(since_epoch_ns - ns(a)) / static_cast<double>(ns(*b) - ns(a));
  teletact::TruthSample s = a;
  s.x_m += f * (b->x_m - a.x_m);
  s.y_m += f * (b->y_m - a.y_m);
  s.yaw_rad += f * std::remainder(b->yaw_rad - a.yaw_rad, 2 * std::numbers::pi);
  return s;
}

struct Visit {
  Driven driven;
  double camera_off_mm = 0;  // claimed frames against the twin, largest
  double visitor_m = 1e9;  // least distance from the base's centre to the visitor's axis, and when
  double visitor_at_s = 0;
  double mark_m = 1e9;  // from where the base is at the end to what was marked
  int claimed = 0, frames = 0;
  std::uint32_t moving_cells = 0;
};

Visit visit(const Scene& s, const VirtualRun& r) {
  Visit v;
  v.driven = judge(s, r);
  const drivers::World world(startup().token(), s.world);
  const int body = world.find("visitor");
  for (const auto& t : r.robot.view.truth) {
    const std::int64_t ns = rt::ns_of(t.stamp) - r.robot.epoch_ns;
    const Vec3 p = world.X_WS_at(body, rt::time_from_ns(ns)).translation();
    const double d = std::hypot(p.x() - t.x_m, p.y() - t.y_m);
    if (d < v.visitor_m) v.visitor_m = d, v.visitor_at_s = 1e-9 * static_cast<double>(ns);
  }
  if (!r.op.view.paths.empty()) {
    const Vec3& mark = r.op.view.paths.back().marked_W;
    v.mark_m = std::hypot(v.driven.end_x_m - mark.x(), v.driven.end_y_m - mark.y());
  }
  const Pose X_BC = s.camera.X_BC();
  const bool tell = std::getenv("TELETACT_VISIT") != nullptr;
  for (const auto& f : r.op.view.fusion) {
    if (!f.consumed) continue;
    ++v.frames;
    v.moving_cells = std::max(v.moving_cells, f.moving_cells);
    const std::int64_t ns = rt::ns_of(f.exposure) - r.op.epoch_ns;
    const auto t = truth_at(r, ns);
    Pose X_WB = Pose::Identity();
    X_WB.linear() = Eigen::AngleAxisd(t.yaw_rad, Vec3::UnitZ()).toRotationMatrix();
    X_WB.translation() = Vec3(t.x_m, t.y_m, 0);
    const Vec3 p(static_cast<double>(f.p_WC[0]), static_cast<double>(f.p_WC[1]),
                 static_cast<double>(f.p_WC[2]));
    const double off = 1e3 * ((X_WB * X_BC).translation() - p).norm();
    const Vec3 q = world.X_WS_at(body, rt::time_from_ns(ns)).translation();
    if (tell)
      std::printf(
          "%7.3f s robot %.2f %.2f %5.0f deg visitor %.2f %.2f claimed %d off %.1f mm share %.3f "
          "cells %u\n",
          1e-9 * static_cast<double>(ns), t.x_m, t.y_m, t.yaw_rad * 57.3, q.x(), q.y(),
          f.claimed ? 1 : 0, off, static_cast<double>(f.moving_share), f.moving_cells);
    if (!f.claimed) continue;
    ++v.claimed;
    v.camera_off_mm = std::max(v.camera_off_mm, off);
  }
  std::printf(
      "  %u collisions, %s at %.2f s, %u paths, %.2f m driven; visitor %.3f m from the base's "
      "centre at %.2f s; %d of %d frames claimed, at most %.1f mm off; %u cells\n",
      v.driven.collisions,
      v.driven.arrived  ? "arrived"
      : v.driven.failed ? "no way"
                        : "NEITHER",
      v.driven.arrived_at_s, v.driven.paths, v.driven.way_m, v.visitor_m, v.visitor_at_s, v.claimed,
      v.frames, v.camera_off_mm, v.moving_cells);
  return v;
}

Scene& visited_scene() {
  static const std::unique_ptr<Scene> scene = visited();
  return *scene;
}

VirtualRun& visited_run() {
  static VirtualRun r = drive(visited_scene(), kSeconds);
  return r;
}

const VirtualRun& default_run() {
  static const std::unique_ptr<Scene> scene = room();
  static const VirtualRun r = drive(*scene, kSeconds);
  return r;
}

TEST(Visitor, TheBaseTouchesNobodyAndArrives) {
  const Visit v = visit(*visited(), visited_run());
  EXPECT_EQ(v.driven.collisions, 0U);
  EXPECT_TRUE(v.driven.arrived);
  EXPECT_LT(v.driven.speed_at_end_m_per_s, 0.01);
  EXPECT_GE(v.driven.paths, 2U) << "the way was made again";
  EXPECT_GE(v.claimed, v.frames * 98 / 100);
  EXPECT_LT(v.camera_off_mm, 20);
  EXPECT_GT(v.moving_cells, 40U);
  EXPECT_GT(v.visitor_m, 0.24 + 0.35);
  EXPECT_LE(v.mark_m, 0.20) << "as in the default scene";
}

// The walk is in the base's way: as it drives in the default scene it would run into them.
TEST(Visitor, TheDriveWithoutThemWouldHit) {
  const drivers::World world(startup().token(), visited()->world);
  double hit_s = 0;
  for (const auto& t : default_run().robot.view.truth) {
    const std::int64_t ns = rt::ns_of(t.stamp) - default_run().robot.epoch_ns;
    const int shape = world.robot_collision(t.x_m, t.y_m, t.yaw_rad, rt::time_from_ns(ns));
    if (shape < 0) continue;
    EXPECT_EQ(world.shapes()[static_cast<std::size_t>(shape)].name, "visitor");
    hit_s = 1e-9 * static_cast<double>(ns);
    break;
  }
  std::printf("  at %.2f s\n", hit_s);
  EXPECT_GT(hit_s, 0);
}

// Nobody tells planning that something moves: the base runs into them, or ends elsewhere.
TEST(Visitor, WithoutTheObstacleItIsNotDone) {
  const auto scene = visited({"fusion.ground.moving.on=false"});
  const Visit v = visit(*scene, drive(*scene, kSeconds));
  EXPECT_EQ(v.moving_cells, 0U);
  EXPECT_TRUE(v.driven.collisions > 0 || v.mark_m > 0.5) << v.mark_m;
}

// Nothing of them is left on their way: a second after the end of the walk no cell of it is an
// obstacle.
TEST(Visitor, TheirWayIsFreeAfterwards) {
  const auto scene = visited();
  const drivers::World world(startup().token(), scene->world);
  const int body = world.find("visitor");
  const perception::CostMap& map = *visited_run().op.view.map;
  ASSERT_TRUE(map.ground_found);
  EXPECT_EQ(map.moving_count, 0);
  const Vec3 stands = world.X_WS_at(body, rt::time_from_ns(19'000'000'000)).translation();
  int looked = 0, left = 0;
  for (int i = 0; i < map.width * map.height; ++i) {
    const Vec3 p = map.X_WM * Vec3((i % map.width + 0.5) * map.resolution,
                                   (i / map.width + 0.5) * map.resolution, 0);
    bool walked = false;
    for (std::int64_t ms = 5600; ms < 14000 && !walked; ms += 50) {
      const Vec3 q = world.X_WS_at(body, rt::time_from_ns(ms * 1'000'000)).translation();
      walked = std::hypot(p.x() - q.x(), p.y() - q.y()) < 0.24;
    }
    // Not where something stands, they themselves included.
    double nearest = std::hypot(p.x() - stands.x(), p.y() - stands.y()) - 0.24;
    for (const double z : {0.1, 0.3, 0.5, 0.7, 0.9}) {
      const Vec3 at(p.x(), p.y(), z);
      for (int s = 0; s < static_cast<int>(world.shapes().size()); ++s)
        if (world.shapes()[static_cast<std::size_t>(s)].mover < 0)
          if (world.find("floor") != s) nearest = std::min(nearest, world.signed_distance(at, s));
    }
    if (!walked || nearest < 0.12) continue;
    ++looked;
    left += map.cost[static_cast<std::size_t>(i)] == perception::CostMap::kOccupied ? 1 : 0;
  }
  std::printf("  %d of %d cells of their way are occupied\n", left, looked);
  EXPECT_GT(looked, 200);
  EXPECT_EQ(left, 0);
}

struct Touch {
  double step_N = 0, guard_share = 0, force_N = 0;
  int begins = 0;
  bool finite = true;
};
Touch touch_of(const VirtualRun& r) {
  Touch t;
  int contact = 0, guard = 0;
  bool before = false;
  for (const auto& s : r.op.view.haptic) {
    t.step_N = std::max(t.step_N, static_cast<double>(s.step_N));
    t.force_N = std::max(t.force_N, static_cast<double>(s.force_N));
    t.finite = t.finite && s.finite;
    contact += s.in_contact ? 1 : 0;
    guard += s.in_contact && s.guard_use ? 1 : 0;
    t.begins += s.in_contact && !before ? 1 : 0;
    before = s.in_contact;
  }
  t.guard_share = static_cast<double>(guard) / std::max(1, contact);
  return t;
}

// The hand touches the same things in all of these rooms.
void expect_guarded_as_in_the_default_scene(const Touch& v) {
  const Touch plain = touch_of(default_run());
  std::printf(
      "  step behind the guard %.3f N, default scene %.3f; guard in use %.4f, %.4f; force %.2f N, "
      "%.2f; %d, %d contacts\n",
      v.step_N, plain.step_N, v.guard_share, plain.guard_share, v.force_N, plain.force_N, v.begins,
      plain.begins);
  EXPECT_TRUE(v.finite);
  EXPECT_GT(plain.step_N, 0);
  EXPECT_LE(v.step_N, 1.1 * plain.step_N);
  EXPECT_LE(v.guard_share, 0.06);
  EXPECT_GE(v.force_N, 3.0) << "it pressed";
  EXPECT_LE(v.force_N, 12.0);
  EXPECT_GE(v.begins, 3);
}

TEST(Visitor, TheHandIsGuardedAsInTheDefaultScene) {
  expect_guarded_as_in_the_default_scene(touch_of(visited_run()));
}

// What `teletact demo --scene ... --clock virtual` returns for such a run.
int exit_status(const Scene& scene, const VirtualRun& r) {
  DemoOptions options;
  options.seconds = kSeconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  options.report = testing::TempDir() + "teletact-" + scene.title + "-" + std::to_string(getpid());
  std::filesystem::create_directories(options.report);
  teletact::RunInfo info;
  info.virtual_clock = true;
  info.seconds = kSeconds;
  info.folder = options.report;
  info.admission = r.admission;
  info.modes = r.modes;
  info.effects = r.effects;
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const int status = teletact::finish_run(options, scene, info, r.op, r.robot, "");
  const std::string said = testing::internal::GetCapturedStderr();
  (void)testing::internal::GetCapturedStdout();
  std::filesystem::remove_all(options.report);
  if (!said.empty()) std::printf("  said: %s", said.c_str());
  return status;
}

// Exit 0, and that for its goal: the script asked for one, the run was long enough to be judged by
// it, and the same run of which it is said that it got nowhere does not exit 0.
void expect_exit_0(const Scene& scene, VirtualRun& r) {
  DemoOptions options;
  options.seconds = kSeconds;
  const auto goal = teletact::check_goal(scene, options, r.op, r.robot);
  EXPECT_TRUE(goal.asked);
  EXPECT_TRUE(goal.judged);
  EXPECT_EQ(goal.missed, "");
  EXPECT_EQ(exit_status(scene, r), 0);
  auto& phase = r.op.view.task.phase;
  const auto was = std::exchange(phase, tasks::TaskState::Phase::kFailed);
  EXPECT_EQ(exit_status(scene, r), 1);
  phase = was;
}

TEST(Visitor, TheDemoExitsWithoutAProblem) { expect_exit_0(visited_scene(), visited_run()); }

struct ArmRun {
  std::unique_ptr<Scene> scene = teletact::load_scene(teletact::find_config("scenes", "arm"), {});
  int body_pixels = 0;  // in the middle of the reach
  VirtualRun run;

  ArmRun() {
    DemoOptions options;
    options.seconds = kSeconds;
    options.virtual_clock = options.quiet = true;
    options.cores = 2;
    options.meddle_at_s = 6.1;
    options.meddle = [this](teletact::OperatorBox& box) {
      const auto mask = box.graph().fusion().pixel_mask();
      for (int v = 0; v < mask.height; ++v)
        for (int u = 0; u < mask.width; ++u)
          body_pixels += mask.at(u, v) == static_cast<std::uint8_t>(perception::PixelOf::kBody);
    };
    run = teletact::run_virtual(startup().token(), *scene, options,
                                teletact::reference_calibration());
  }
};

ArmRun& arm() {
  static ArmRun r;
  return r;
}

// The arm is before the camera, hides a part of the place and is not it: the base drives to the
// mark as if it were not there.
TEST(Arm, TheBaseTouchesNothingAndArrives) {
  const auto& r = arm().run;
  const Driven d = judge(*arm().scene, r);
  ASSERT_FALSE(r.op.view.paths.empty());
  const Vec3& mark = r.op.view.paths.back().marked_W;
  const double mark_m = std::hypot(d.end_x_m - mark.x(), d.end_y_m - mark.y());
  int frames = 0, claimed = 0;
  for (const auto& f : r.op.view.fusion) frames += f.consumed, claimed += f.consumed && f.claimed;
  std::printf(
      "  %u collisions, %s at %.2f s, %u paths, %.2f m driven, %.3f m to the mark, clearance %.3f "
      "m; %d of %d frames claimed; %d pixels of the arm at 6.1 s\n",
      d.collisions, d.arrived ? "arrived" : "NOT THERE", d.arrived_at_s, d.paths, d.way_m, mark_m,
      d.clearance_m, claimed, frames, arm().body_pixels);
  EXPECT_GT(arm().body_pixels, 5000) << "the arm is in view, or this says nothing";
  EXPECT_EQ(d.collisions, 0U);
  EXPECT_TRUE(d.arrived);
  EXPECT_LT(d.speed_at_end_m_per_s, 0.01);
  EXPECT_GT(d.way_m, 1.5);
  EXPECT_LE(mark_m, 0.20) << "as in the default scene";
  EXPECT_GT(frames, 590);
  EXPECT_GE(claimed, frames * 98 / 100);
}

TEST(Arm, TheDemoExitsWithoutAProblem) { expect_exit_0(*arm().scene, arm().run); }

TEST(Arm, TheHandIsGuardedAsInTheDefaultScene) {
  expect_guarded_as_in_the_default_scene(touch_of(arm().run));
}

// What no single key can be wrong about is one line that names file and mover.
TEST(Visitor, AWalkThatCanNotBeIsRefused) {
  const std::string path = teletact::find_config("scenes", "visitor");
  const auto refusal = [&](const std::string& key) -> std::string {
    try {
      (void)teletact::load_scene(path, {key});
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return {};
  };
  for (const auto& [key, said] : std::vector<std::pair<std::string, std::string>>{
           {"world.mover=[{name=\"m\", shapes=\"visitor\", kind=\"walk\", speed_m_per_s=20}]",
            "speed_m_per_s"},
           {"world.mover=[{name=\"m\", shapes=\"nobody\", kind=\"walk\", "
            "waypoint=[{offset_m=[1,0,0]}]}]",
            "no shape 'nobody'"},
           {"world.mover=[{name=\"m\", shapes=\"visitor\", kind=\"walk\"}]", "no waypoint"}}) {
    const std::string what = refusal(key);
    EXPECT_NE(what.find(said), std::string::npos) << key << ": " << what;
    const bool of_a_key = said == "speed_m_per_s";  // one of its own range names where it was set
    EXPECT_EQ(what.rfind(of_a_key ? "command line" : path, 0), 0U) << what;
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
  }
}

}  // namespace
}  // namespace tests
