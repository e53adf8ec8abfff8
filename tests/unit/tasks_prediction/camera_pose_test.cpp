// The task with the camera's poses: where the base is in the map, and what it does without them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "tasks/prediction/prediction_task.hpp"
#include "tests/unit/tasks_prediction/prediction_loop.hpp"

namespace tests {
namespace {

// The camera's pose, 33 ms apart and so late that it comes with a later robot state.
void see(Loop& l, double dark_from_s = 1e9, rt::Nanos late = 120ms) {
  if (l.ms % 33 != 0 || l.ms * 1e-3 > dark_from_s) return;
  drivers::PoseHistory::Sample s;
  if (!l.bus.history().at(l.now - late, s)) return;
  l.camera.seq++;
  l.camera.exposure = l.now - late;
  l.camera.X_WC = perception::Pose::Identity();
  l.camera.X_WC.translation() = perception::Vec3(s.X_WB.x, s.X_WB.y, 0);
  l.camera.X_WC.linear() =
      Eigen::AngleAxisd(s.X_WB.yaw, perception::Vec3::UnitZ()).toRotationMatrix();
  l.camera.tracking = CameraPose::Tracking::kTracking;
  l.camera.claimed = true;
  l.pin.camera = &l.camera;
}

// Wheels that slip and are worn, as the default scene has them, and what it states of them.
drivers::RobotPlantConfig slipping(std::uint64_t seed) {
  drivers::RobotPlantConfig plant;
  plant.wheel_slip_max = 0.1;
  plant.wheel_slip_seed = seed;
  plant.wheel_radius_error.fill(-0.01);
  plant.encoder_ticks_per_motor_turn = 4000;
  return plant;
}
PredictionConfig stated() {
  PredictionConfig c;
  c.world.odometry_translation_share = c.world.odometry_rotation_share = 0.065;
  c.world.odometry_deg_per_m = 2.2;
  return c;
}

// Odometry is far off at the end; with the camera's poses the base ends where the path does in the
// map, without them it does not.
TEST(PredictionTask, TheCamerasPoseDrives) {
  for (const bool on : {false, true}) {
    double worst = 0, least = 1e9, moving = 0;
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      PredictionConfig c = stated();
      c.map_correction = on;
      Loop l(20ms, c, slipping(seed));
      l.path = make_path(1, {{0, 0, 0}, {2.5, 0, 0.4}, {2.5, 1.5, 1.5}});
      l.pin.path = &l.path;
      for (int i = 0; i < 18000; ++i) {
        see(l);
        l.tick();
        const auto& t = l.pout.telemetry;
        if (on && l.ms % 100 == 51 && l.ms > 1000) {
          drivers::PoseHistory::Sample s;
          ASSERT_TRUE(l.bus.history().at(l.state.taken, s));
          moving = std::max(moving, std::hypot(t.X_WB.x - s.X_WB.x, t.X_WB.y - s.X_WB.y));
          EXPECT_LT(std::hypot(t.X_WB.x - s.X_WB.x, t.X_WB.y - s.X_WB.y), l.pout.frame.error_m);
          EXPECT_TRUE(l.pout.frame.known && l.pout.frame.follows_camera && !l.pout.frame.unsure);
        }
      }
      const double off = std::hypot(l.truth().X_WB.x - 2.5, l.truth().X_WB.y - 1.5);
      worst = std::max(worst, off), least = std::min(least, off);
    }
    std::printf("  %s: end error %.1f to %.1f mm, under way at most %.1f mm\n",
                on ? "the camera drives" : "the wheels drive", 1e3 * least, 1e3 * worst,
                1e3 * moving);
    if (on) {
      EXPECT_LT(worst, 0.003);
      EXPECT_LT(moving, 0.02);
    } else {
      EXPECT_GT(least, 0.05);
    }
  }
}

// The camera goes dark in mid-drive: the base stands before it is truly off by the limit, says so,
// and stays; when the camera is back it goes on and arrives.
TEST(PredictionTask, ADarkCameraStopsTheBaseBeforeItIsOffByTheLimit) {
  double worst = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Loop l(20ms, stated(), slipping(seed));
    l.path = make_path(1, {{0, 0, 0}, {4, 0, 0}});
    l.pin.path = &l.path;
    const double dark = 2.0 + 0.1 * static_cast<double>(seed);
    for (int i = 0; i < 12000; ++i) {
      see(l, dark);
      l.tick();
      if (!l.state.taken.time_since_epoch().count()) continue;
      const auto& t = l.pout.telemetry;
      drivers::PoseHistory::Sample s;
      if (l.ms % 100 == 51 && l.bus.history().at(l.state.taken, s))
        worst = std::max(worst, std::hypot(t.X_WB.x - s.X_WB.x, t.X_WB.y - s.X_WB.y));
    }
    EXPECT_LT(l.truth().v_B.vx, 1e-6) << "stands, seed " << seed;
    EXPECT_LT(l.truth().X_WB.x, 3.0) << "seed " << seed;
    EXPECT_EQ(l.health.fault, fault::kPlaceUnsure);
    EXPECT_TRUE(l.pout.frame.unsure);
    EXPECT_EQ(l.pout.goal.engaged, 0);
    EXPECT_LE(l.pout.frame.error_m, 0.15) << "seed " << seed;
    EXPECT_GT(l.pout.frame.error_m, 0.09) << "and not far before, seed " << seed;
    for (int i = 0; i < 9000; ++i) {
      see(l);
      l.tick();
    }
    EXPECT_NEAR(l.truth().X_WB.x, 4, 0.003) << "seed " << seed;
  }
  std::printf("  dark: truly off by at most %.1f mm\n", 1e3 * worst);
  EXPECT_LT(worst, 0.15);
  EXPECT_GT(worst, 0.005);
}

// In a map of another day nobody knows where the base is before the camera is found in it.
TEST(PredictionTask, NothingDrivesWhereTheStartIsNotKnown) {
  rt::Startup startup;
  PredictionTask task(startup.token(), stated(), tasks::Pose::Identity(), false);
  RobotState state;
  ModeMsg mode;
  mode.mode = Mode::kEngaged;
  CameraPose camera;
  Path path = make_path(1, {{3, 0, 0}, {5, 0, 0}});
  PredictionTask::In in;
  PredictionTask::Out out;
  in.robot = &state, in.mode = &mode, in.path = &path;
  in.delay_known = true;
  in.round_trip = 40ms;
  rt::Tick tick;
  tick.period = 100ms;
  for (int i = 1; i <= 20; ++i) {
    tick.start = tick.release = rt::time_from_ns(100'000'000LL * i);
    state.seq = static_cast<std::uint64_t>(i);
    state.taken = tick.start - 20ms;
    if (i == 11) {
      in.camera = &camera;
      camera.seq = 1;
      camera.exposure = tick.start - 60ms;
      camera.claimed = true;
      camera.tracking = CameraPose::Tracking::kTracking;
      camera.X_WC.translation() = perception::Vec3(3, 0, 0);
    }
    const rt::Health health = task.step(tick, in, out);
    EXPECT_EQ(out.goal.engaged, i < 11 ? 0 : 1) << i;
    EXPECT_EQ(out.frame.known, i >= 11) << i;
    EXPECT_EQ(health.fault, i < 11 ? fault::kPlaceUnsure : rt::kNoFault) << i;
  }
  EXPECT_NEAR(out.telemetry.X_WB.x, 3, 1e-4);
}

TEST(PredictionTask, UnbelievableCameraPoseIsRefused) {
  Loop l(20ms, PredictionConfig{});
  l.path = make_path(1, {{0, 0, 0}, {2, 0, 0}});
  l.pin.path = &l.path;
  l.run(1000);
  l.pin.camera = &l.camera;
  l.camera.seq = 1;
  l.camera.exposure = l.now - 50ms;
  l.camera.tracking = CameraPose::Tracking::kTracking;
  l.camera.claimed = true;
  l.camera.X_WC.translation() = perception::Vec3(30, 0, 0);
  l.run(100);
  EXPECT_EQ(rt::worst(l.health, rt::Health::ok()).fault, fault::kPlaceUnsure) << "who is right?";
  EXPECT_EQ(l.pout.telemetry.X_WO, Pose2{});
  EXPECT_EQ(l.pout.goal.engaged, 0);
  l.camera.seq = 2;
  l.camera.exposure += 100ms;
  l.camera.X_WC.matrix().setConstant(std::nan(""));
  l.run(100);
  EXPECT_EQ(l.pout.telemetry.X_WO, Pose2{});
  EXPECT_TRUE(std::isfinite(l.pout.goal.x_m));
}

}  // namespace
}  // namespace tests
