#include "drivers/youbot/robot_plant.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "rt/effect_count.hpp"
#include "rt/random.hpp"

namespace drivers {
namespace {

using perception::Pose2;
using perception::Twist2;

// Below this speed (rad/s at the wheel) and without a setpoint a wheel counts as standing.
constexpr double kStandstill = 1e-9;

WheelVector to_array(const Eigen::Vector4d& v) noexcept { return {v[0], v[1], v[2], v[3]}; }
Eigen::Vector4d to_vector(const WheelVector& v) noexcept { return {v[0], v[1], v[2], v[3]}; }

Eigen::Matrix4d wheel_mass_matrix(const RobotPlantConfig& c, const Mecanum& kinematics) {
  Eigen::Matrix<double, 3, 4> F;
  for (int i = 0; i < kWheels; ++i) {
    WheelVector unit{};
    unit[i] = 1.0;
    const Twist2 v = kinematics.forward(unit);
    F.col(i) << v.vx, v.vy, v.wz;
  }
  const Eigen::Vector3d body(c.mass_kg, c.mass_kg, c.inertia_kg_m2);
  return c.wheel_inertia_kg_m2 * Eigen::Matrix4d::Identity() +
         F.transpose() * body.asDiagonal() * F;
}

}  // namespace

RobotPlant::RobotPlant(rt::NonRealtime&, const RobotPlantConfig& config, const MecanumConfig& base,
                       const Pose2& start_X_WB, CollisionTest collides)
    : config_(config),
      kinematics_(uncalibrated(base)),
      collides_(std::move(collides)),
      mass_(wheel_mass_matrix(config, kinematics_)),
      mass_inverse_(mass_.inverse()),
      step_ns_(std::chrono::microseconds{config.substep_us}) {
  if (!perception::is_finite(start_X_WB)) {
    throw std::invalid_argument("robot plant: the start pose is not finite");
  }
  if (collides_ && collides_(start_X_WB, rt::Time{})) {
    throw std::invalid_argument("robot plant: the robot collides at its start pose (" +
                                std::to_string(start_X_WB.x) + ", " + std::to_string(start_X_WB.y) +
                                ", " + std::to_string(start_X_WB.yaw) + ")");
  }
  dt_ = rt::seconds(step_ns_);
  // Speed loop: poles at the configured bandwidth for the inertia of a wheel in straight drive.
  const double r = kinematics_.wheel_radius();
  const double inertia = config.wheel_inertia_kg_m2 + config.mass_kg * r * r / 4;
  const double w = config.speed_loop_rad_per_s;
  kp_ = 2.0 * config.speed_loop_damping * w * inertia;
  ki_ = w * w * inertia;
  if (config.slip_ratio > 0) slip_ = Slip{config.slip_ratio};
  if (config.wheel_slip_max > 0) {
    const std::int64_t redraw = rt::nanos_from_seconds(config.wheel_slip_redraw_s).count();
    wheel_slip_ = WheelSlip{std::max<std::int64_t>(1, redraw / step_ns_.count())};
  }
  if (config.wheel_radius_error != WheelVector{}) {
    radius_.emplace();
    for (int i = 0; i < kWheels; ++i) (*radius_)[i] = 1.0 + config.wheel_radius_error[i];
  }
  if (config.encoder_ticks_per_motor_turn > 0) {
    encoder_ = Encoder{2.0 * std::numbers::pi / config.encoder_ticks_per_motor_turn /
                       kinematics_.gear_ratio()};
  }
  if (config.gear_friction_Nm > 0) friction_ = GearFriction{config.gear_friction_Nm};
  if (config.dead_time_s > 0) {
    const std::int64_t delay = rt::nanos_from_seconds(config.dead_time_s).count();
    dead_steps_ = (delay + step_ns_.count() - 1) / step_ns_.count();
  }
  using rt::Effect;
  if (config.speed_loop_order > 0) rt::effect_built(Effect::kMotorDynamics);
  if (slip_) rt::effect_built(Effect::kSlip);
  if (wheel_slip_) rt::effect_built(Effect::kWheelSlip);
  if (radius_) rt::effect_built(Effect::kWheelRadius);
  if (encoder_) rt::effect_built(Effect::kEncoder);
  if (friction_) rt::effect_built(Effect::kGearFriction);
  if (dead_steps_ > 0) rt::effect_built(Effect::kDeadTime);
  check_every_ = std::max<std::int64_t>(1, 1'000'000 / step_ns_.count());
  state_.X_WB = start_X_WB;
  checked_X_WB_ = start_X_WB;
}

void RobotPlant::advance(rt::Time now) noexcept {
  if (!started_) {
    started_ = true;
    epoch_ = now;
    state_.time = now;
    return;
  }
  const std::int64_t target = (now - epoch_).count() / step_ns_.count();
  while (steps_ < target) {
    const Eigen::Vector4d w = to_vector(state_.wheel_rad_per_s);
    const Eigen::Vector4d s = to_vector(setpoint_);
    if (!things_move_ && queue_.size == 0 && w.cwiseAbs().maxCoeff() < kStandstill &&
        s.cwiseAbs().maxCoeff() < kStandstill && integral_.cwiseAbs().maxCoeff() < 1e-12) {
      steps_ = target;  // nothing moves and nothing will: the state is the same at any later time
      break;
    }
    substep();
  }
  state_.time = epoch_ + step_ns_ * steps_;
}

void RobotPlant::command(rt::Time at, const WheelVector& wheel_rad_per_s, bool powered) noexcept {
  if (!started_) advance(at);
  const std::int64_t since = (at - epoch_).count();
  Pending p;
  p.step = (since + step_ns_.count() - 1) / step_ns_.count() + dead_steps_;
  p.powered = powered;
  if (dead_steps_ > 0) rt::effect_ran(rt::Effect::kDeadTime);
  if (powered) p.speed = wheel_rad_per_s;
  const std::size_t n = queue_.slots.size();
  if (queue_.size == n) {
    setpoint_ = queue_.slots[queue_.head].speed;
    queue_.head = (queue_.head + 1) % n;
    --queue_.size;
  }
  queue_.slots[(queue_.head + queue_.size) % n] = p;
  ++queue_.size;
}

void RobotPlant::substep() noexcept {
  while (queue_.size > 0 && queue_.slots[queue_.head].step <= steps_) {
    const Pending& p = queue_.slots[queue_.head];
    setpoint_ = p.powered ? p.speed : WheelVector{};
    queue_.head = (queue_.head + 1) % queue_.slots.size();
    --queue_.size;
  }
  const WheelVector before = state_.wheel_rad_per_s;
  wheel_step();
  // The mean of the speeds at both ends: the trapezoidal rule, second order in the sub-step.
  WheelVector mean{};
  for (int i = 0; i < kWheels; ++i) {
    mean[i] = 0.5 * (before[i] + state_.wheel_rad_per_s[i]);
    state_.wheel_rad[i] += mean[i] * dt_;
  }
  if (wheel_slip_) {
    rt::effect_ran(rt::Effect::kWheelSlip);
    draw_slip();
    for (int i = 0; i < kWheels; ++i) mean[i] *= 1.0 - wheel_slip_->share[i];
  }
  if (radius_) {
    rt::effect_ran(rt::Effect::kWheelRadius);
    for (int i = 0; i < kWheels; ++i) mean[i] *= (*radius_)[i];
  }
  Twist2 v = kinematics_.forward(mean);
  if (slip_) {
    rt::effect_ran(rt::Effect::kSlip);
    const double grip = 1.0 - slip_->ratio;
    v = {grip * v.vx, grip * v.vy, grip * v.wz};
  }
  ++steps_;
  move_step(v);
}

void RobotPlant::draw_slip() noexcept {
  const std::int64_t interval = steps_ / wheel_slip_->redraw_steps;
  if (interval == wheel_slip_->drawn) return;
  wheel_slip_->drawn = interval;
  rt::Random random(config_.wheel_slip_seed, static_cast<std::uint64_t>(interval));
  for (double& share : wheel_slip_->share) share = random.uniform(0, config_.wheel_slip_max);
}

void RobotPlant::wheel_step() noexcept {
  Eigen::Vector4d w = to_vector(state_.wheel_rad_per_s);
  const Eigen::Vector4d wanted = to_vector(setpoint_);
  Eigen::Vector4d torque = Eigen::Vector4d::Zero();
  if (config_.speed_loop_order == 0) {
    w = wanted;
  } else {
    rt::effect_ran(rt::Effect::kMotorDynamics);
    const double limit = config_.torque_limit_Nm;
    const Eigen::Vector4d error = wanted - w;
    if (config_.speed_loop_order == 1) {
      torque = mass_ * (config_.speed_loop_rad_per_s * error);
    } else {
      torque = kp_ * error + ki_ * integral_;
    }
    for (int i = 0; i < kWheels; ++i) {
      const double raw = torque[i];
      torque[i] = std::clamp(raw, -limit, limit);
      // Anti-windup: the integral rests while the motor saturates in the direction of the error.
      if (raw == torque[i] || raw * error[i] < 0) integral_[i] += error[i] * dt_;
    }
    const Eigen::Vector4d driven = w + dt_ * (mass_inverse_ * torque);
    if (friction_) {
      rt::effect_ran(rt::Effect::kGearFriction);
      // Coulomb: takes away at most the motion that is there, so it stops a wheel but never turns
      // it.
      for (int i = 0; i < kWheels; ++i) {
        const double loss = dt_ * mass_inverse_(i, i) * friction_->torque;
        w[i] = driven[i] > loss ? driven[i] - loss : driven[i] < -loss ? driven[i] + loss : 0.0;
      }
    } else {
      w = driven;
    }
  }
  if (stuck_wheel_ >= 0 && stuck_wheel_ < kWheels) {
    w[stuck_wheel_] = 0;
    integral_[stuck_wheel_] = 0;
  }
  state_.wheel_rad_per_s = to_array(w);
  state_.torque_Nm = to_array(torque);
}

void RobotPlant::move_step(const Twist2& v) noexcept {
  const rt::Time t = epoch_ + step_ns_ * steps_;
  const bool check = collides_ && steps_ % check_every_ == 0;
  if (state_.in_contact) {
    state_.v_B = {};
    if (!check || v == Twist2{}) return;
    // At least a millimetre ahead: the last free pose lies a little before the wall, and creeping
    // over that gap would count as a new entry.
    const double speed = std::max(std::hypot(v.vx, v.vy), std::abs(v.wz) * kinematics_.lever());
    const double ahead = std::max(dt_ * static_cast<double>(check_every_), 1e-3 / speed);
    if (!(ahead < 1.0) || collides_(perception::integrate(checked_X_WB_, v, ahead), t)) return;
    state_.in_contact = false;  // the motion leads away: the base comes free where it stands
    state_.v_B = v;
    return;
  }
  state_.X_WB = perception::integrate(state_.X_WB, v, dt_);
  state_.v_B = v;
  state_.path_m += std::hypot(v.vx, v.vy) * dt_;
  if (!check) return;
  if (collides_(state_.X_WB, t)) {
    state_.X_WB = checked_X_WB_;
    state_.v_B = {};
    state_.in_contact = true;
    ++state_.collisions;
  } else {
    checked_X_WB_ = state_.X_WB;
  }
}

WheelVector RobotPlant::encoder_rad() const noexcept {
  if (!encoder_) return state_.wheel_rad;
  rt::effect_ran(rt::Effect::kEncoder);
  WheelVector out{};
  for (int i = 0; i < kWheels; ++i) {
    out[i] = std::round(state_.wheel_rad[i] / encoder_->rad_per_tick) * encoder_->rad_per_tick;
  }
  return out;
}

WheelVector RobotPlant::encoder_rad_per_s() const noexcept {
  if (!encoder_) return state_.wheel_rad_per_s;
  const double rad_per_rpm = 1.0 / kinematics_.motor_rpm(1.0);  // the boards report whole motor rpm
  WheelVector out{};
  for (int i = 0; i < kWheels; ++i) {
    out[i] = std::round(state_.wheel_rad_per_s[i] / rad_per_rpm) * rad_per_rpm;
  }
  return out;
}

std::vector<std::string> RobotPlant::effects() const {
  std::vector<std::string> names;
  if (config_.speed_loop_order > 0) names.emplace_back("motor_dynamics");
  if (slip_) names.emplace_back("slip");
  if (wheel_slip_) names.emplace_back("wheel_slip");
  if (radius_) names.emplace_back("wheel_radius");
  if (encoder_) names.emplace_back("encoder_quantisation");
  if (dead_steps_ > 0) names.emplace_back("dead_time");
  if (friction_) names.emplace_back("gear_friction");
  return names;
}

}  // namespace drivers
