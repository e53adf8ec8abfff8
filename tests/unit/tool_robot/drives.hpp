// Drives whose truth is known: exact ones from the equations alone, and those of the plant that
// slips.
#pragma once

#include <cmath>
#include <functional>
#include <numbers>

#include "drivers/camera/synthetic_camera.hpp"
#include "drivers/youbot/robot_plant.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"
#include "tools/robot/drive_script.hpp"
#include "tools/robot/identify_robot.hpp"

namespace tests {

using perception::Pose;
using perception::Pose2;
using perception::Twist2;
using perception::Vec3;
using teletact::RobotDrive;
using teletact::RobotModel;

inline constexpr double kDeg = std::numbers::pi / 180;

inline Pose raised(const Pose2& p) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(p.yaw, Vec3::UnitZ()).toRotationMatrix();
  X.translation() = Vec3(p.x, p.y, 0);
  return X;
}

inline Vec3 any_vector(rt::Random& random, double size) {
  return {random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size)};
}

inline Pose turned_by(const Vec3& w) {
  Pose X = Pose::Identity();
  if (w.norm() > 0) X.linear() = Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
  return X;
}

inline RobotModel stated_model() { return {{}, drivers::SyntheticCameraConfig{}.X_BC()}; }

// Off the stated one: radii by shares, mount by metres and degrees.
inline RobotModel any_model(rt::Random& random, double share, double off_m, double off_deg) {
  RobotModel m = stated_model();
  for (double& s : m.base.wheel_scale) s = 1 + random.uniform(-share, share);
  m.base.lever_scale = 1 + random.uniform(-share, share);
  m.base.slide_scale = 1 + random.uniform(-share, share);
  m.X_BC.linear() = turned_by(any_vector(random, off_deg * kDeg)).linear() * m.X_BC.linear();
  m.X_BC.translation() += any_vector(random, off_m);
  return m;
}

using Twists = std::function<Twist2(double t)>;

struct CameraNoise {
  double m = 0, deg = 0;       // of every pose, each axis
  double unclaimed_share = 0;  // of the time, in stretches of up to two seconds
  double false_share = 0;      // of the poses, off by up to half a metre
};

inline teletact::FloorSeen floor_of(const RobotModel& truth) {
  return {truth.X_BC.linear().transpose() * Vec3::UnitZ(), truth.X_BC.translation().z()};
}

inline void add_camera(RobotDrive& drive, double t, const Pose& X_WC, const CameraNoise& noise,
                       rt::Random& random, double& dark_until) {
  const double stretch_s = 2.0, each_s = 1.0 / 30;
  if (t < dark_until) return;
  if (random.uniform() < noise.unclaimed_share * each_s / (stretch_s / 2)) {
    dark_until = t + random.uniform(0, stretch_s);
    return;
  }
  Pose X = X_WC;
  const Vec3 w(random.normal(), random.normal(), random.normal());
  const Vec3 p(random.normal(), random.normal(), random.normal());
  X.linear() = X.linear() * turned_by(noise.deg * kDeg * w).linear();
  X.translation() += noise.m * p;
  if (random.uniform() < noise.false_share) X.translation() += any_vector(random, 0.5);
  drive.cameras.push_back({t, X});
}

// No noise: the equations of a rigid base whose wheels roll.
inline RobotDrive exact_drive(const RobotModel& truth, const Twists& at, double seconds,
                              const Pose& X_WP) {
  constexpr double kStep_s = 0.02;
  const drivers::Mecanum kinematics(truth.base);
  RobotDrive drive;
  Pose2 X_PB;
  drivers::WheelVector rad{3, -2, 1, 40};  // counters begin anywhere
  for (int k = 0; k * kStep_s <= seconds; ++k) {
    const double t = 100 + k * kStep_s;
    drive.wheels.push_back({t, rad});
    drive.cameras.push_back({t, X_WP * raised(X_PB) * truth.X_BC});
    const Twist2 v = at(k * kStep_s);
    const drivers::WheelVector w = kinematics.inverse(v);
    for (int i = 0; i < drivers::kWheels; ++i) rad[i] += w[i] * kStep_s;
    X_PB = perception::integrate(X_PB, v, kStep_s);
  }
  return drive;
}

// The plant's wheels slip and are worn, its encoders step; the base is driven as one that believes
// `stated`.
inline RobotDrive plant_drive(rt::NonRealtime& nrt, const drivers::RobotPlantConfig& plant_config,
                              const RobotModel& stated, const Pose& X_BC, const Twists& at,
                              double seconds, const CameraNoise& noise, std::uint64_t seed) {
  drivers::RobotPlant plant(nrt, plant_config, stated.base, {});
  const drivers::Mecanum kinematics(stated.base);
  rt::Random random(seed, 77);
  const Pose X_WP = turned_by(any_vector(random, 0.3));
  RobotDrive drive;
  double dark_until = -1;
  const auto start = rt::time_from_ns(0);
  plant.advance(start);
  for (int k = 0; 1e-3 * k <= seconds; ++k) {
    const auto now = start + std::chrono::milliseconds{k};
    plant.advance(now);
    plant.command(now, kinematics.inverse(at(1e-3 * k)), true);
    if (k % 5 == 0) drive.wheels.push_back({1e-3 * k, plant.encoder_rad()});
    if (k % 33 == 0) {
      add_camera(drive, 1e-3 * k, X_WP * raised(plant.state().X_WB) * X_BC, noise, random,
                 dark_until);
    }
  }
  return drive;
}

// The radii that odometry can know of: worn, and less by the mean slip.
inline drivers::MecanumConfig effective_base(const drivers::RobotPlantConfig& plant) {
  drivers::MecanumConfig base;
  for (int i = 0; i < drivers::kWheels; ++i) {
    base.wheel_scale[i] = (1 + plant.wheel_radius_error[i]) * (1 - plant.wheel_slip_max / 2);
  }
  return base;
}

}  // namespace tests
