#include "tasks/robot_io/trajectory.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {
namespace {

using perception::Pose2;
using perception::wrap_angle;

// The braking curve uses less than the planner's acceleration, so that a velocity across the
// approach can be taken out while braking and the goal is not passed.
constexpr double kBrakeShare = 0.8;

double norm(const PlanarVelocity& v) noexcept { return std::hypot(v.x, v.y); }

// `from` moved toward `to` by at most `step`.
PlanarVelocity slew(const PlanarVelocity& from, const PlanarVelocity& to, double step,
                    double yaw_step) noexcept {
  PlanarVelocity out = to;
  const double dx = to.x - from.x, dy = to.y - from.y;
  const double d = std::hypot(dx, dy);
  if (d > step) {
    out.x = from.x + dx * (step / d);
    out.y = from.y + dy * (step / d);
  }
  out.yaw = from.yaw + std::clamp(to.yaw - from.yaw, -yaw_step, yaw_step);
  return out;
}

}  // namespace

double braking_speed(double distance, double acceleration, double dt) noexcept {
  const double adt = acceleration * dt;
  return std::sqrt(adt * adt + 2.0 * acceleration * std::max(distance, 0.0)) - adt;
}

PlanarVelocity Trajectory::track(const TrajectoryTarget& target, const Pose2& X_OB,
                                 double dt) noexcept {
  const TrajectoryConfig& c = config_;
  const double speed = std::min(c.speed_m_per_s, target.speed_limit_m_per_s);
  const double a = c.planning_share * c.acceleration_m_per_s2;
  const double a_yaw = c.planning_share * c.yaw_acceleration_rad_per_s2;

  // Reference toward the goal.
  PlanarVelocity wanted;
  const double ex = target.X_OG.x - X_OR_.x, ey = target.X_OG.y - X_OR_.y;
  const double d = std::hypot(ex, ey);
  if (d > 1e-9) {
    const double through = std::max(0.0, (target.v_O.x * ex + target.v_O.y * ey) / d);
    const double v = std::min(
        speed, std::hypot(braking_speed(d, kBrakeShare * a, dt), std::min(through, speed)));
    wanted.x = v * ex / d;
    wanted.y = v * ey / d;
  }
  const double e_yaw = wrap_angle(target.X_OG.yaw - X_OR_.yaw);
  wanted.yaw = std::copysign(
      std::min(c.yaw_rate_rad_per_s, braking_speed(std::abs(e_yaw), kBrakeShare * a_yaw, dt)),
      e_yaw);
  const PlanarVelocity before = v_ref_;
  v_ref_ = slew(v_ref_, wanted, a * dt, a_yaw * dt);
  X_OR_.x += v_ref_.x * dt;
  X_OR_.y += v_ref_.y * dt;
  X_OR_.yaw = wrap_angle(X_OR_.yaw + v_ref_.yaw * dt);

  // A base that does not follow holds the reference on a leash: no stored-up error, no leap later.
  double lag_x = X_OR_.x - X_OB.x, lag_y = X_OR_.y - X_OB.y;
  double lag_yaw = wrap_angle(X_OR_.yaw - X_OB.yaw);
  const double lag = std::hypot(lag_x, lag_y);
  if (lag > c.leash_m) {
    lag_x *= c.leash_m / lag;
    lag_y *= c.leash_m / lag;
    X_OR_.x = X_OB.x + lag_x;
    X_OR_.y = X_OB.y + lag_y;
  }
  if (std::abs(lag_yaw) > c.leash_rad) {
    lag_yaw = std::copysign(c.leash_rad, lag_yaw);
    X_OR_.yaw = wrap_angle(X_OB.yaw + lag_yaw);
  }

  // Feed-forward and feedback, inside the limits.
  const double lead = c.motor_lag_s / dt;
  PlanarVelocity command;
  command.x = v_ref_.x + lead * (v_ref_.x - before.x) + c.position_gain_per_s * lag_x;
  command.y = v_ref_.y + lead * (v_ref_.y - before.y) + c.position_gain_per_s * lag_y;
  command.yaw = v_ref_.yaw + lead * (v_ref_.yaw - before.yaw) + c.yaw_gain_per_s * lag_yaw;
  const double v = norm(command);
  if (v > speed) {
    command.x *= speed / v;
    command.y *= speed / v;
  }
  command.yaw = std::clamp(command.yaw, -c.yaw_rate_rad_per_s, c.yaw_rate_rad_per_s);
  limit_command(command, dt);
  return v_cmd_;
}

PlanarVelocity Trajectory::brake(const Pose2& X_OB, double dt) noexcept {
  limit_command({}, dt);
  return let_reference_follow(X_OB);
}

PlanarVelocity Trajectory::ramp_down(const Pose2& X_OB, double dt) noexcept {
  v_cmd_ = slew(v_cmd_, {}, config_.ramp_down_deceleration_m_per_s2 * dt,
                config_.ramp_down_yaw_deceleration_rad_per_s2 * dt);
  return let_reference_follow(X_OB);
}

PlanarVelocity Trajectory::let_reference_follow(const Pose2& X_OB) noexcept {
  X_OR_ = X_OB;
  v_ref_ = v_cmd_;
  return v_cmd_;
}

void Trajectory::start_from(const Pose2& X_OB, const PlanarVelocity& v_O) noexcept {
  v_cmd_ = v_O;
  v_ref_ = v_O;
  X_OR_ = X_OB;
}

bool Trajectory::moving() const noexcept {
  return norm(v_cmd_) > 1e-4 || std::abs(v_cmd_.yaw) > 1e-4;
}

void Trajectory::limit_command(PlanarVelocity wanted, double dt) noexcept {
  v_cmd_ = slew(v_cmd_, wanted, config_.acceleration_m_per_s2 * dt,
                config_.yaw_acceleration_rad_per_s2 * dt);
}

}  // namespace tasks
