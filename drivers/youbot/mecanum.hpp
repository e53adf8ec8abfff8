// Kinematics of the youBot base: four mecanum wheels with rollers at 45 degrees.
//
// Wheel order: 0 front left, 1 front right, 2 back left, 3 back right; the equations carry the
// signs of the robot's own wiring (left wheels turn backward for forward drive). Body frame B:
// x forward, y left, z up. SI units.
// Source: youbot_driver FourSwedishWheelOmniBaseKinematic.cpp (radius 0.0475 m, axles 0.47 m and
// 0.30 m apart); its forward form leaves slide_ratio out, ours keeps it so that
// forward(inverse(v)) = v for every ratio.
// The scales hold the calibration of a single robot (`teletact identify robot`): the effective
// rolling radius of a wheel is wheel_radius_m times its scale. They are this program's estimate;
// the virtual robot is built by the other keys.
#pragma once

#include <algorithm>
#include <array>
#include <numbers>

#include "config/schema.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "perception/geometry/planar.hpp"

namespace drivers {

// Section [robot.base] of a robot file.
struct MecanumConfig {
  double wheel_radius_m = 0.0475;
  double axle_distance_m = 0.47;       // front to rear
  double track_width_m = 0.30;         // left to right
  double slide_ratio = 1.0;            // sideways speed per wheel speed; 1 = rollers at 45 degrees
  double gear_ratio = 9405.0 / 364.0;  // motor turns per wheel turn
  // Found by calibration; 1: as the keys above say.
  std::array<double, kWheels> wheel_scale{1, 1, 1, 1};
  double lever_scale = 1;  // of (axle_distance_m + track_width_m) / 2
  double slide_scale = 1;  // of slide_ratio

  void describe(config::Section& s) {
    s.number("wheel_radius_m", wheel_radius_m, 0.01, 0.5, "rolling radius of a wheel");
    s.number("axle_distance_m", axle_distance_m, 0.05, 3, "front axle to rear axle");
    s.number("track_width_m", track_width_m, 0.05, 3, "left wheels to right wheels");
    s.number("slide_ratio", slide_ratio, 0.1, 2, "sideways travel per wheel travel");
    s.number("gear_ratio", gear_ratio, 1, 1000, "motor turns per wheel turn");
    s.numbers("wheel_scale", wheel_scale, 0.5, 2,
              "calibrated rolling radius of each wheel over wheel_radius_m");
    s.number("lever_scale", lever_scale, 0.5, 2,
             "calibrated lever of the turn over (axle_distance_m + track_width_m) / 2");
    s.number("slide_scale", slide_scale, 0.5, 2, "calibrated slide_ratio over the stated one");
  }
};

using WheelVector = std::array<double, kWheels>;

// The same base as its drawing has it.
[[nodiscard]] inline MecanumConfig uncalibrated(MecanumConfig c) {
  c.wheel_scale.fill(1);
  c.lever_scale = c.slide_scale = 1;
  return c;
}

class Mecanum {
 public:
  explicit Mecanum(const MecanumConfig& c = {}) noexcept
      : r_(c.wheel_radius_m),
        k_((c.axle_distance_m + c.track_width_m) / 2 * c.lever_scale),
        s_(c.slide_ratio * c.slide_scale),
        gear_(c.gear_ratio),
        c_(c.wheel_scale) {}

  // Wheel speeds (rad/s) that give the body twist without slip.
  [[nodiscard]] WheelVector inverse(const perception::Twist2& v) const noexcept {
    const double y = v.vy / s_, w = k_ * v.wz;
    return {(-v.vx + y + w) / (r_ * c_[0]), (v.vx + y + w) / (r_ * c_[1]),
            (-v.vx - y + w) / (r_ * c_[2]), (v.vx - y + w) / (r_ * c_[3])};
  }
  // Body twist of the wheel speeds: least squares, since four wheels carry three freedoms. Also
  // maps wheel angle differences (rad) to body displacement (m, m, rad).
  [[nodiscard]] perception::Twist2 forward(const WheelVector& turned) const noexcept {
    const double q = r_ / 4;
    const WheelVector w{turned[0] * c_[0], turned[1] * c_[1], turned[2] * c_[2], turned[3] * c_[3]};
    return {q * (-w[0] + w[1] - w[2] + w[3]), s_ * q * (w[0] + w[1] - w[2] - w[3]),
            q / k_ * (w[0] + w[1] + w[2] + w[3])};
  }
  // Largest wheel speed of a twist, rad/s; of wheels that are not alike, at most that.
  [[nodiscard]] double peak_wheel_speed(const perception::Twist2& v) const noexcept {
    const double y = v.vy / s_;
    return ((v.vx < 0 ? -v.vx : v.vx) + (y < 0 ? -y : y) + k_ * (v.wz < 0 ? -v.wz : v.wz)) /
           (r_ * std::min({c_[0], c_[1], c_[2], c_[3]}));
  }
  [[nodiscard]] double motor_rpm(double wheel_rad_per_s) const noexcept {
    return wheel_rad_per_s * gear_ * 60.0 / (2.0 * std::numbers::pi);
  }
  [[nodiscard]] double wheel_radius() const noexcept { return r_; }
  [[nodiscard]] double lever() const noexcept { return k_; }
  [[nodiscard]] double gear_ratio() const noexcept { return gear_; }

 private:
  double r_, k_, s_, gear_;
  std::array<double, kWheels> c_;
};

// Pose by dead reckoning from absolute wheel angles. The first sample only sets the zero. A gap
// (lost frames) is covered by the next sample, since the angles are absolute; the arc between two
// samples is taken as one constant twist, which is exact for equal wheel speeds in between.
class Odometry {
 public:
  explicit Odometry(const Mecanum& kinematics, const perception::Pose2& start = {}) noexcept
      : kinematics_(kinematics), X_OB_(start) {}

  // False, and nothing changes, if an angle is not finite or the body would have moved further than
  // `max_step_m` (or as many radians times the lever): a broken encoder word, not motion.
  bool update(const WheelVector& wheel_rad, double max_step_m = 1.0) noexcept {
    WheelVector d{};
    for (int i = 0; i < kWheels; ++i) {
      if (!std::isfinite(wheel_rad[i])) return false;
      d[i] = wheel_rad[i] - last_[i];
    }
    if (primed_) {
      const perception::Twist2 step = kinematics_.forward(d);
      if (std::hypot(step.vx, step.vy) > max_step_m ||
          std::abs(step.wz) * kinematics_.lever() > max_step_m) {
        return false;
      }
      X_OB_ = perception::compose(X_OB_, perception::exp_se2(step));
    }
    last_ = wheel_rad;
    primed_ = true;
    return true;
  }
  void reset(const perception::Pose2& X_OB) noexcept {
    X_OB_ = X_OB;
    primed_ = false;
  }
  [[nodiscard]] const perception::Pose2& pose() const noexcept { return X_OB_; }
  [[nodiscard]] bool primed() const noexcept { return primed_; }

 private:
  Mecanum kinematics_;
  perception::Pose2 X_OB_;
  WheelVector last_{};
  bool primed_ = false;
};

}  // namespace drivers
