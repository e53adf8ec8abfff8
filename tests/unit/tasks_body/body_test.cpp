// An arm that does a full reach before the camera: the map, the cost map and the camera's way are
// as without it.
//
// Pictures of the synthetic camera, Kinect v2 noise, 512 x 424, voxels of 20 mm. What is counted in
// the map: voxels with a vertex of the mesh within 50 mm of where the arm was at any time, and more
// than 30 mm off every surface of the room.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <set>

#include "drivers/camera/render.hpp"
#include "drivers/camera/scripted_arm.hpp"
#include "drivers/camera/synthetic_camera.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "rt/memory/section.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/world_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

constexpr double kDt = 1.0 / 30;
constexpr double kDegree = std::numbers::pi / 180;
constexpr auto kBody = static_cast<std::uint8_t>(perception::PixelOf::kBody);

rt::Startup startup;

rt::Time seconds(double s) { return rt::Time{rt::nanos_from_seconds(s)}; }

std::shared_ptr<const perception::RobotDescription> youbot() {
  auto r = perception::load_robot(tests::in_tree("config/robots/youbot.toml"));
  if (!r) throw std::runtime_error(r.error());
  return std::make_shared<perception::RobotDescription>(std::move(r).value());
}

// Folded up, stretched out before the base, to the side, and back.
drivers::ScriptedArmConfig full_reach() {
  drivers::ScriptedArmConfig c;
  c.keys.push_back({0.3, {169, 65, -146, 102.5, 167.5}});
  c.keys.push_back({2.1, {169, 145, -146, 102.5, 167.5}});
  c.keys.push_back({2.9, {140, 140, -150, 110, 140}});
  c.keys.push_back({4.6, {169, 65, -146, 102.5, 167.5}});
  return c;
}
constexpr int kFrames = 145;

struct Case {
  bool arm_there = true, masked = true;
  drivers::ScriptedArmConfig script = full_reach();
  int frames = kFrames;
  bool motion = true;  // what moves is looked for and left out
  std::shared_ptr<const perception::RobotDescription> robot =
      nullptr;  // that fusion knows; none: the youBot
};

tasks::FusionConfig config() {
  tasks::FusionConfig c;
  c.tsdf.voxel_size_m = 0.02;
  c.tsdf.max_blocks = 16384;
  c.patch_nodes = 32;
  return c;
}

// The base drives a curve.
Pose X_WB_at(double t) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(0.05 * std::sin(0.8 * t), Vec3::UnitZ()).toRotationMatrix();
  X.translation() = Vec3(0.06 * t, -0.02 * t, 0);
  return X;
}

double distance(const drivers::Shape& s, const Vec3& p_W) {
  const Vec3 p = s.X_WS.inverse() * p_W;
  return Vec3(p.x(), p.y(), p.z() - std::clamp(p.z(), -s.half.z(), s.half.z())).norm() - s.half.x();
}

class Bench {
 public:
  explicit Bench(const Case& run)
      : run_(run),
        world(test_support::load_world(startup.token(), "default_room.toml")),
        arm(startup.token(), run.script, *robot_, rt::Time{}),
        noise_(startup.token(), drivers::DepthNoiseConfig{1.0, 0.3, 0.5, 0.02}),
        scratch_(startup.token(), world.shapes().size() + arm.shapes() + 4),
        nowhere_(startup.token(), {}) {
    tasks::FusionSetup setup;
    setup.camera = camera.intrinsics();
    setup.X_BC = camera.X_BC();
    setup.X_WC0 = X_WB_at(0) * setup.X_BC;
    setup.ground.up_known = true;
    setup.ground.camera_height_m = camera.mount_position_m[2];
    if (run.masked) setup.robot = run.robot ? run.robot : robot_;
    tasks::FusionConfig c = config();
    if (!run.motion) c.motion.on = false;
    task = std::make_unique<tasks::FusionTask>(startup.token(), c, setup);
  }

  void render(double t) {
    std::vector<drivers::Shape> shapes;
    const auto placed = arm.place(seconds(t), X_WB_at(t));
    if (run_.arm_there) shapes.assign(placed.begin(), placed.end());
    shapes.insert(shapes.end(), further.begin(), further.end());
    drivers::render(world, camera.intrinsics(), X_WB_at(t) * camera.X_BC(), {}, noise_, 1, n_,
                    scratch_, *frame, drivers::World::kBeginning, shapes);
    frame->exposure = seconds(t);
    frame->joints = run_.arm_there ? arm.reported(seconds(t)) : perception::JointAngles{};
  }
  // Frame n_ and the step that takes it.
  void step() {
    const double t = kDt * static_cast<double>(n_);
    render(t);
    take(t);
    const double off =
        (task->camera().translation() - (X_WB_at(t) * camera.X_BC()).translation()).norm();
    sum2_ += off * off;
    claimed += out.camera.claimed;
    if (run_.arm_there) {
      const auto placed = arm.place(seconds(t), X_WB_at(t));
      sweep.insert(sweep.end(), placed.begin(), placed.end());
    }
    if (n_ % 5 == 0 && run_.masked && run_.arm_there) measure_area(t);
    ++n_;
  }
  void take(double t) {
    in.frame = frame.get();
    in.frame_fresh = true;
    out.cost_map = cost.get();
    rt::Tick tick;
    tick.k = n_;
    tick.release = tick.start = seconds(t + 0.02);
    rt_guard::reset();
    {
      rt::Section section;
      health = task->step(tick, in, out);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  Bench& all() {
    for (int i = 0; i < run_.frames; ++i) {
      step();
      if (i % 16 != 15 && i + 1 != run_.frames) continue;
      const Cells cells = obstacle_cells();
      most_swept = std::max(most_swept, cells.swept);
      least_room = std::min(least_room, cells.room);
    }
    return *this;
  }

  [[nodiscard]] double ate_mm() const { return 1e3 * std::sqrt(sum2_ / static_cast<double>(n_)); }
  // Voxels of the map that hold a surface where `there` were and nothing of the room is.
  [[nodiscard]] int ghosts(const perception::TsdfMap& map, const std::vector<drivers::Shape>& there,
                           double within = 0.05) const {
    std::set<std::array<int, 3>> voxels;
    for (const auto& v : extract_mesh(startup.token(), map).vertices_W) {
      const Vec3 p = v.cast<double>();
      if (std::abs(world.signed_distance(p)) <= 0.03) continue;
      for (const auto& s : there) {
        if ((p - s.X_WS.translation()).norm() > s.bound_radius_m + within) continue;
        if (distance(s, p) > within) continue;
        voxels.insert({static_cast<int>(std::floor(p.x() / 0.02)),
                       static_cast<int>(std::floor(p.y() / 0.02)),
                       static_cast<int>(std::floor(p.z() / 0.02))});
        break;
      }
    }
    return static_cast<int>(voxels.size());
  }
  struct Cells {
    int swept =
        0;  // occupied within 50 mm of the arm's sweep, seen from above, nothing of the room in them
    int room = 0;  // occupied, and something of the room stands there: the map was written and sees
  };
  [[nodiscard]] Cells obstacle_cells() const {
    Cells n;
    for (int iy = 0; iy < cost->height; ++iy) {
      for (int ix = 0; ix < cost->width; ++ix) {
        if (cost->cost[cost->index(ix, iy)] != perception::CostMap::kOccupied) continue;
        const Vec3 p_W =
            cost->X_WM * Vec3((ix + 0.5) * cost->resolution, (iy + 0.5) * cost->resolution, 0);
        bool room = false, swept = false;
        for (double z = 0.06; z < 1.2; z += 0.02) {
          const Vec3 p(p_W.x(), p_W.y(), z);
          room |= world.signed_distance(p) < cost->resolution;
          if (room) break;
        }
        if (room) {
          ++n.room;
          continue;
        }
        for (std::size_t i = 0; i < sweep.size() && !swept; i += 3) {
          for (double z = 0.06; z < 1.2 && !swept; z += 0.04)
            swept = distance(sweep[i], Vec3(p_W.x(), p_W.y(), z)) < 0.05 + cost->resolution;
        }
        n.swept += swept;
      }
    }
    return n;
  }

  drivers::SyntheticCameraConfig camera;
  tasks::FusionTask::In in;
  tasks::FusionTask::Out out;
  rt::Health health;
  std::vector<drivers::Shape> sweep, further;
  int claimed = 0;
  double worst_area = 0;
  double least_covered = 1;  // of the arm's own pixels, in any image that shows it: in the mask
  int most_swept = 0, least_room = 1 << 20;  // cells, of a map twice a second and of the last one
  int areas = 0;                             // images in which it was looked at
  std::int64_t sum_masked = 0, sum_silhouette = 0;

 private:
  void measure_area(double t) {
    const auto placed = arm.place(seconds(t), X_WB_at(t));
    drivers::render(nowhere_, camera.intrinsics(), X_WB_at(t) * camera.X_BC(), {0.01, 20}, {}, 1, 0,
                    scratch_, *silhouette_, drivers::World::kBeginning, placed);
    int area = 0, masked = 0, covered = 0;
    const auto mask = task->pixel_mask();
    for (int v = 0; v < mask.height; ++v) {
      for (int u = 0; u < mask.width; ++u) {
        area += silhouette_->depth().at(u, v) != 0;
        masked += mask.at(u, v) == kBody;
        covered += silhouette_->depth().at(u, v) != 0 && mask.at(u, v) == kBody;
      }
    }
    EXPECT_EQ(masked, out.body_pixels);
    sum_masked += masked;
    sum_silhouette += area;
    if (area == 0) return;
    ++areas;
    worst_area = std::max(worst_area, static_cast<double>(masked) / area);
    least_covered = std::min(least_covered, static_cast<double>(covered) / area);
  }

  Case run_;
  std::shared_ptr<const perception::RobotDescription> robot_ = youbot();

 public:
  drivers::World world;
  drivers::ScriptedArm arm;
  std::unique_ptr<tasks::FusionTask> task;
  std::unique_ptr<perception::CostMap> cost = std::make_unique<perception::CostMap>();
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
  std::uint64_t n_ = 0;

 private:
  drivers::DepthNoise noise_;
  drivers::RenderScratch scratch_;
  drivers::World nowhere_;
  std::unique_ptr<RgbdFrame> silhouette_ = std::make_unique<RgbdFrame>();
  double sum2_ = 0;
};

double plain_ate_mm() {
  static const double ate = [] {
    Bench b(Case{.arm_there = false, .masked = false});
    return b.all().ate_mm();
  }();
  return ate;
}

void print(const char* what, Bench& b) {
  std::printf(
      "  %s: ATE %.2f mm (without the arm %.2f), claimed %d of %d, %d voxels, %d cells (at least "
      "%d "
      "of the room), of the arm's pixels at least %.3f masked in %d images, area %.3f (worst "
      "%.3f)\n",
      what, b.ate_mm(), plain_ate_mm(), b.claimed, kFrames, b.ghosts(b.task->map(), b.sweep),
      b.most_swept, b.least_room, b.least_covered, b.areas,
      b.sum_silhouette > 0
          ? static_cast<double>(b.sum_masked) / static_cast<double>(b.sum_silhouette)
          : 0.0,
      b.worst_area);
}

// No cell of the sweep is occupied in any map, and the maps are there: they show the room. That the
// arm would be in them: OfABodyNotDescribedTheCostMapIsFull.
void expect_no_obstacle(const Bench& b) {
  EXPECT_TRUE(b.cost->ground_found);
  EXPECT_GE(b.least_room, 400);
  EXPECT_EQ(b.most_swept, 0);
}

// All of the arm is masked in every image that shows it; a mask may be larger, an empty one is
// none.
void expect_masked(const Bench& b) {
  EXPECT_GE(b.areas, 20);
  EXPECT_GE(b.least_covered, 0.99);
}

TEST(Body, AFullReachWithExactJointsLeavesNothing) {
  Bench b(Case{});
  b.all();
  print("exact joints", b);
  EXPECT_EQ(b.claimed, kFrames);
  EXPECT_EQ(b.ghosts(b.task->map(), b.sweep), 0);
  expect_no_obstacle(b);
  EXPECT_NEAR(b.ate_mm(), plain_ate_mm(), 2);
  EXPECT_LE(b.worst_area, 1.5);
  expect_masked(b);
}

// What the mask is for, and that the count above can be anything but 0: the same images fused where
// they were taken.
TEST(Body, FusedWithItsArmTheMapIsFullOfIt) {
  Bench b(Case{});
  perception::TsdfMap map(startup.token(), config().tsdf);
  std::vector<drivers::Shape> sweep;
  for (int i = 0; i < kFrames; i += 2) {
    const double t = kDt * i;
    b.render(t);
    map.integrate(perception::FrameView::of(*b.frame), X_WB_at(t) * b.camera.X_BC(), 2);
    const auto placed = b.arm.place(seconds(t), X_WB_at(t));
    sweep.insert(sweep.end(), placed.begin(), placed.end());
  }
  EXPECT_GT(b.ghosts(map, sweep), 50);
}

// The same for the cost map: whom the robot is not described to holds its arm for an obstacle, in
// the same run.
TEST(Body, OfABodyNotDescribedTheCostMapIsFull) {
  Bench b(Case{.masked = false});
  b.all();
  print("not described", b);
  EXPECT_TRUE(b.cost->ground_found);
  EXPECT_GE(b.most_swept, 25);
  EXPECT_GE(b.least_room, 400);
  EXPECT_GT(b.ghosts(b.task->map(), b.sweep), 20);
}

TEST(Body, JointsThatAreLate) {
  Case run;
  run.script.joint_delay_ms = 50;
  Bench b(run);
  b.all();
  print("joints 50 ms late", b);
  EXPECT_NEAR(b.ate_mm(), plain_ate_mm(), 5);
  EXPECT_LE(b.ghosts(b.task->map(), b.sweep) * 0.02 * 0.02 * 0.02, 1e-4);
  expect_masked(b);
  expect_no_obstacle(b);
}

TEST(Body, JointsThatAreWrong) {
  for (const double error : {2.0, -2.0}) {
    Case run;
    run.script.joint_error_deg = error;
    Bench b(run);
    b.all();
    print(error > 0 ? "joints 2 degrees wrong" : "joints -2 degrees wrong", b);
    EXPECT_NEAR(b.ate_mm(), plain_ate_mm(), 5);
    EXPECT_LE(b.ghosts(b.task->map(), b.sweep) * 0.02 * 0.02 * 0.02, 1e-4);
    expect_masked(b);
    expect_no_obstacle(b);
  }
}

// Nobody knows where the body is: the image is not used, is not a pose, and the next one goes on
// from before.
TEST(Body, WithoutGoodJointsTheImageIsRefused) {
  Bench b(Case{.frames = 12});
  b.all();
  const auto frames = b.task->frames();
  const auto blocks = b.task->map().block_count();
  const auto refused = [&b](auto&& spoil) {
    const double t = kDt * static_cast<double>(b.n_);
    b.render(t);
    spoil(b.frame->joints);
    b.take(t);
    return b.health.fault == tasks::kFaultFusionNoJoints && !b.out.camera_written &&
           !b.out.integrated && b.health.severity == rt::Severity::kCounted;
  };
  using Q = perception::JointAngles;
  EXPECT_TRUE(refused([](Q& q) { q.count = 0; }));
  EXPECT_TRUE(refused([](Q& q) { q.count = 4; }));
  EXPECT_TRUE(refused([](Q& q) { q.age_s = 0.101F; }));
  EXPECT_TRUE(refused([](Q& q) { q.age_s = std::nanf(""); }));
  EXPECT_TRUE(refused([](Q& q) { q.position[1] = std::nanf(""); }));
  EXPECT_TRUE(refused([](Q& q) { q.error = INFINITY; }));
  EXPECT_EQ(b.task->frames(), frames);
  EXPECT_EQ(b.task->map().block_count(), blocks);
  EXPECT_FALSE(refused([](Q& q) { q.age_s = 0.099F; }));
  EXPECT_EQ(b.task->frames(), frames + 1);
  EXPECT_TRUE(b.out.camera.claimed);
}

// A body that is out of view changes no bit, and marks nothing.
TEST(Body, OutOfViewItChangesNothing) {
  perception::RobotDescription behind;
  auto& tail = behind.links.emplace_back();
  tail.name = "tail", tail.joint = "revolute", tail.origin_m = {-0.8, 0, 0.9};
  tail.lower = -1, tail.upper = 1;
  tail.capsules.emplace_back();
  Case run;
  run.arm_there = false;
  run.frames = 15;
  run.robot = std::make_shared<perception::RobotDescription>(behind);
  Bench with(run);
  run.masked = false;
  Bench without(run);
  for (int i = 0; i < run.frames; ++i) {
    const double t = kDt * i;
    for (Bench* b : {&with, &without}) {
      b->render(t);
      b->frame->joints.count = b == &with ? 1 : 0;
      b->take(t);
      ++b->n_;
    }
    ASSERT_EQ(with.out.body_pixels, 0);
    ASSERT_EQ(with.task->camera().matrix(), without.task->camera().matrix()) << i;
  }
  const auto a = extract_mesh(startup.token(), with.task->map());
  const auto c = extract_mesh(startup.token(), without.task->map());
  ASSERT_EQ(a.vertices_W.size(), c.vertices_W.size());
  for (std::size_t i = 0; i < a.vertices_W.size(); ++i) ASSERT_EQ(a.vertices_W[i], c.vertices_W[i]);
}

// A box hangs before the arm, is taken, carried about and let go: in the map before the grasp and
// after the release, in between nowhere.
TEST(Body, WhatItHoldsIsBodyFromGraspToRelease) {
  Case run;
  run.script.keys.clear();
  run.script.keys.push_back({1.0, {169, 125, -146, 102.5, 167.5}});
  run.script.keys.push_back({2.2, {130, 125, -146, 102.5, 167.5}});
  Bench b(run);
  perception::HeldObject held;
  held.id = 1;
  held.half = Vec3(0.04, 0.04, 0.10);
  held.X_GO.translation() = Vec3(0, 0, 0.20);
  // As four rods and their ends: the renderer carries any shape.
  drivers::Shape box;
  box.kind = drivers::Shape::Kind::kBox;
  box.name = "held";
  box.half = held.half;
  drivers::derive(box);
  const auto at_gripper = [&](double t) {
    perception::ArticulatedBody::Links X_BL;
    b.arm.body().forward(b.arm.at(seconds(t)).q, X_BL);
    return Pose(X_WB_at(t) * X_BL[static_cast<std::size_t>(b.arm.body().gripper())] * held.X_GO);
  };
  const auto in_map = [&](const Pose& X_WO) {  // near the box's middle, off the room
    int n = 0;
    for (const auto& v : extract_mesh(startup.token(), b.task->map()).vertices_W) {
      const Vec3 p = v.cast<double>();
      n += (p - X_WO.translation()).norm() < 0.15 && std::abs(b.world.signed_distance(p)) > 0.03;
    }
    return n;
  };
  const auto run_to = [&](double end, auto&& pose) {
    while (kDt * static_cast<double>(b.n_) < end) {
      const double t = kDt * static_cast<double>(b.n_);
      box.X_WS = pose(t);
      b.further = {box};
      b.render(t);
      b.take(t);
      ++b.n_;
    }
  };
  // The base drives on meanwhile: before the grasp the box stands in the world, where the gripper
  // will be at 0.9 s.
  const Pose X_WO = at_gripper(0.9);
  run_to(0.9, [&](double) { return X_WO; });
  const int before = in_map(X_WO);
  EXPECT_GT(before, 20);
  b.in.held = held;
  run_to(1.1, at_gripper);
  EXPECT_EQ(in_map(X_WO), 0);  // a few frames after the grasp
  run_to(2.2, at_gripper);
  EXPECT_EQ(in_map(X_WO), 0);
  EXPECT_EQ(in_map(at_gripper(2.1)), 0);
  b.in.held.reset();
  const Pose X_WR = at_gripper(2.2);  // let go: it stays, the base drives on
  run_to(3.2, [&](double) { return X_WR; });
  EXPECT_GT(in_map(X_WR), 20);
  std::printf("  held: %d vertices before the grasp, %d after the release\n", before, in_map(X_WR));
}

}  // namespace
