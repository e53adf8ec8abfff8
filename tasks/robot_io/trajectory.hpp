// Trajectory planner and tracking controller of the base: from the pose where it is to a goal pose
// that may change at any tick, with bounded speed and acceleration and without passing the goal.
//
// Planner     On-line, no look-ahead table: each tick the wanted velocity points at the goal
//             with the speed from which the base can still stop there, v(d) = sqrt((a T)^2 + 2 a
//             d) - a T (the discrete braking curve), and the reference velocity follows it by at
//             most a T. Position and yaw are planned side by side in the odometry frame O.
// Controller  Feed-forward of the reference velocity (with the lag of the motors' speed loop)
//             plus a proportional term on the pose error; then the limits once more, so that what
//             is sent never exceeds them, whatever the error.
#pragma once

#include "config/schema.hpp"
#include "perception/geometry/planar.hpp"

namespace tasks {

// Section [robot_io.trajectory] and gains.
struct TrajectoryConfig {
  double speed_m_per_s = 0.5;
  double yaw_rate_rad_per_s = 0.8;
  double acceleration_m_per_s2 = 1.0;
  double yaw_acceleration_rad_per_s2 = 1.6;
  // Of a ramp-down, where standing soon is worth more than a smooth ride: docs/faults.md.
  double ramp_down_deceleration_m_per_s2 = 4.0;
  double ramp_down_yaw_deceleration_rad_per_s2 = 6.4;
  double planning_share = 0.8;  // of the acceleration; the rest is left to the controller
  double position_gain_per_s = 4.0;
  double yaw_gain_per_s = 4.0;
  double motor_lag_s = 0.002;  // fed forward: reference velocity + lag x acceleration
  double leash_m = 0.10;       // the reference waits when the base is this far behind
  double leash_rad = 0.25;

  void describe(config::Section& s) {
    s.number("speed_m_per_s", speed_m_per_s, 0.01, 0.8, "largest speed of the base");
    s.number("yaw_rate_rad_per_s", yaw_rate_rad_per_s, 0.01, 0.8, "largest turn rate");
    s.number("acceleration_m_per_s2", acceleration_m_per_s2, 0.05, 5, "largest acceleration");
    s.number("yaw_acceleration_rad_per_s2", yaw_acceleration_rad_per_s2, 0.05, 20,
             "largest yaw acceleration");
    s.number("ramp_down_deceleration_m_per_s2", ramp_down_deceleration_m_per_s2, 0.05, 8,
             "deceleration of a ramp-down");
    s.number("ramp_down_yaw_deceleration_rad_per_s2", ramp_down_yaw_deceleration_rad_per_s2, 0.05,
             40, "yaw deceleration of a ramp-down");
    s.number("planning_share", planning_share, 0.3, 1, "share of the acceleration that is planned");
    s.number("position_gain_per_s", position_gain_per_s, 0, 20, "pose error to speed");
    s.number("yaw_gain_per_s", yaw_gain_per_s, 0, 20, "yaw error to turn rate");
    s.number("motor_lag_s", motor_lag_s, 0, 0.2, "lag of the speed loop, fed forward");
    s.number("leash_m", leash_m, 0.01, 1, "reference waits beyond this error");
    s.number("leash_rad", leash_rad, 0.02, 2, "reference waits beyond this yaw error");
  }
};

// Velocity in the fixed frame O: unlike a body twist, its rate of change is the acceleration.
struct PlanarVelocity {
  double x = 0, y = 0, yaw = 0;
};

struct TrajectoryTarget {
  perception::Pose2 X_OG;  // goal pose
  PlanarVelocity v_O;      // velocity wanted at the goal (zero: stop there)
  double speed_limit_m_per_s = 1e9;
};

// Speed from which a distance can still be braked: discrete braking curve, never past the goal.
[[nodiscard]] double braking_speed(double distance, double acceleration, double dt) noexcept;

class Trajectory {
 public:
  explicit Trajectory(const TrajectoryConfig& c) noexcept : config_(c) {}

  // One tick toward the goal; `X_OB` is the measured pose. Returns the velocity to command, in O.
  PlanarVelocity track(const TrajectoryTarget&, const perception::Pose2& X_OB, double dt) noexcept;
  // One tick of slowing down to a halt with the acceleration limit. The reference follows the base.
  PlanarVelocity brake(const perception::Pose2& X_OB, double dt) noexcept;
  // The same with the deceleration of a ramp-down.
  PlanarVelocity ramp_down(const perception::Pose2& X_OB, double dt) noexcept;
  // At once: the command is zero, no ramp (safe stop).
  void zero_at_once(const perception::Pose2& X_OB) noexcept { start_from(X_OB, {}); }
  // Command and reference are where the base is: the next tick goes on from there.
  void start_from(const perception::Pose2& X_OB, const PlanarVelocity& v_O) noexcept;

  [[nodiscard]] const perception::Pose2& reference() const noexcept { return X_OR_; }
  [[nodiscard]] const PlanarVelocity& command() const noexcept { return v_cmd_; }
  [[nodiscard]] bool moving() const noexcept;

 private:
  void limit_command(PlanarVelocity wanted, double dt) noexcept;
  PlanarVelocity let_reference_follow(const perception::Pose2& X_OB) noexcept;

  TrajectoryConfig config_;
  perception::Pose2 X_OR_;
  PlanarVelocity v_ref_, v_cmd_;
};

}  // namespace tasks
