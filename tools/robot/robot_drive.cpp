#include "tools/robot/robot_drive.hpp"

#include <cstdio>
#include <memory>
#include <stdexcept>

#include "drivers/youbot/virtual_youbot.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/robot/drive_problem.hpp"
#include "tools/robot/floor_seen.hpp"

namespace teletact {

using perception::Pose;
using perception::Pose2;
using perception::Vec3;

namespace {

constexpr double kStand_s = 0.5;  // before the first leg: the map begins
constexpr int kLogEvery_ms = 5;   // of the wheels
constexpr int kFloorEvery = 15;   // claimed frames

// The camera rides on the base's true pose.
class OnBase final : public drivers::PoseSource {
 public:
  OnBase(const drivers::VirtualYoubot& bus, const Pose& X_BC, const Pose& X_WB0)
      : bus_(bus), X_BC_(X_BC), X_WB_(X_WB0) {}
  [[nodiscard]] Pose X_WC_at(rt::Time t) noexcept override {
    drivers::PoseHistory::Sample s;
    if (bus_.history().at(t, s)) X_WB_ = pose_on_floor(s.X_WB);
    return X_WB_ * X_BC_;
  }

 private:
  const drivers::VirtualYoubot& bus_;
  Pose X_BC_, X_WB_;
};

tasks::FusionSetup fusion_setup(const Scene& scene) {
  tasks::FusionSetup setup;
  setup.camera = scene.camera.intrinsics();
  setup.X_BC = scene.camera.X_BC();
  setup.robot = scene.robot;
  setup.X_WC0 = scene.start_X_WB() * setup.X_BC;
  setup.ground.up_known = true;
  setup.ground.start_W = scene.start_X_WB().translation();
  setup.ground.camera_height_m = scene.camera.mount_position_m[2];
  return setup;
}

class Drive {
 public:
  Drive(rt::NonRealtime& nrt, const Scene& scene, const DriveScript& script)
      : scene_(scene),
        script_(script),
        world_(nrt, scene.world, kEpoch),
        bus_(nrt, scene.bus, plant(nrt)),
        pose_(bus_, scene.camera.true_X_BC(), scene.start_X_WB()),
        camera_(nrt, scene.camera, world_, pose_, kEpoch),
        kinematics_(scene.graph.robot_io.base),
        odometry_(kinematics_, start()),
        task_(nrt, scene.graph.fusion, fusion_setup(scene)),
        feed_(task_) {
    if (scene.robot != nullptr) {
      camera_.carry(nrt,
                    std::make_unique<drivers::ScriptedArm>(nrt, scene.arm, *scene.robot, kEpoch));
    }
  }

  TwinDrive run(const std::function<void(double)>& progress) {
    const auto ticks = static_cast<int>(1e3 * (script_.seconds() + 2 * kStand_s));
    for (int k = 0; k <= ticks; ++k) {
      const double t = 1e-3 * k;
      move(k, t);
      look(t);
      if (progress && k % 1000 == 0) progress(t);
    }
    return std::move(out_);
  }

 private:
  static constexpr rt::Time kEpoch = rt::Time{std::chrono::seconds{1}};

  [[nodiscard]] Pose2 start() const {
    const auto& io = scene_.graph.robot_io;
    return {io.start_x_m, io.start_y_m, io.start_yaw_rad};
  }
  [[nodiscard]] drivers::RobotPlant plant(rt::NonRealtime& nrt) {
    const drivers::World* world = &world_;
    drivers::RobotPlant p(nrt, scene_.plant, scene_.graph.robot_io.base, start(),
                          [world](const Pose2& X, rt::Time t) {
                            return world->robot_collision(X.x, X.y, X.yaw, t) >= 0;
                          });
    if (world_.moves()) p.things_move();
    return p;
  }

  void move(int k, double t) {
    now_ = kEpoch + std::chrono::milliseconds{k};
    drivers::MotorSetpoints setpoints;
    setpoints.mode = drivers::MotorMode::kVelocity;
    setpoints.wheel_rad_per_s = kinematics_.inverse(script_.at(t - kStand_s));
    if (bus_.exchange(now_, setpoints, motors_) != drivers::BusStatus::kOk)
      throw std::runtime_error("the motor bus of the twin is down");
    (void)odometry_.update(motors_.wheel_rad);
    if (k % kLogEvery_ms == 0) out_.drive.wheels.push_back({t, motors_.wheel_rad});
    if (bus_.plant().state().collisions == 0) return;
    const DriveScript::Room r = script_.room();
    char text[300];
    std::snprintf(text, sizeof text,
                  "the base ran into something %.1f s after the start, at (%.2f, %.2f): its centre "
                  "needs %.2f to %.2f m ahead of the start and %.2f to %.2f m to its left, and 0.4 "
                  "m about it; choose robot_io.start_x_m, start_y_m, start_yaw_rad",
                  t, bus_.plant().state().X_WB.x, bus_.plant().state().X_WB.y, r.x_least_m,
                  r.x_most_m, r.y_least_m, r.y_most_m);
    throw std::runtime_error(text);
  }

  void look(double t) {
    if (camera_.poll(now_, feed_.frame()) != drivers::CameraStatus::kFrame) return;
    const perception::Twist2 v = kinematics_.forward(motors_.wheel_rad_per_s);
    feed_.in.odometry = tasks::OdometryPrior{now_, pose_on_floor(odometry_.pose()),
                                             Vec3(v.vx, v.vy, 0), Vec3(0, 0, v.wz)};
    const auto& out = feed_.step(nullptr);
    ++out_.frames;
    if (!out.camera_written || !out.camera.claimed) return;
    const double exposed = t - rt::seconds(now_ - feed_.frame().exposure);
    out_.drive.cameras.push_back({exposed, out.camera.X_WC});
    if (out_.claimed++ % kFloorEvery != 0) return;
    if (const auto f = floor_seen(feed_.frame(), scene_.camera.X_BC(),
                                  static_cast<std::uint64_t>(out_.claimed)))
      out_.drive.floor.push_back(*f);
  }

  const Scene& scene_;
  const DriveScript& script_;
  drivers::World world_;
  drivers::VirtualYoubot bus_;
  OnBase pose_;
  drivers::SyntheticCamera camera_;
  drivers::Mecanum kinematics_;
  drivers::Odometry odometry_;
  tasks::FusionTask task_;
  FusionFeed feed_;
  drivers::MotorStates motors_;
  rt::Time now_{};
  TwinDrive out_;
};

}  // namespace

RobotModel stated_robot(const Scene& scene) {
  return {scene.graph.robot_io.base, scene.camera.X_BC()};
}

TwinDrive drive_twin(rt::NonRealtime& nrt, const Scene& scene, const DriveScript& script,
                     const std::function<void(double)>& progress) {
  if (!scene.rgbd_dir.empty() || !scene.camera_choice.in_process())
    throw std::runtime_error(
        "only the twin is driven by this program: of a real robot give --wheels and --poses");
  const auto drive = std::make_unique<Drive>(nrt, scene, script);
  TwinDrive out = drive->run(progress);
  out.truth.base = drivers::uncalibrated(scene.graph.robot_io.base);
  for (std::size_t i = 0; i < drivers::kWheels; ++i) {
    out.truth.base.wheel_scale[i] = (1 + scene.plant.wheel_radius_error[i]) *
                                    (1 - scene.plant.wheel_slip_max / 2) *
                                    (1 - scene.plant.slip_ratio);
  }
  out.truth.X_BC = scene.camera.true_X_BC();
  return out;
}

}  // namespace teletact
