#include "drivers/youbot_bus/twin/loaded_drive.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace drivers::youbot_bus {

namespace {

constexpr double kLoop_rad_per_s = 100;
constexpr double kRad_per_s_per_rpm = 2 * std::numbers::pi / 60;
// A load behind a gap has some inertia: less than any that this robot moves.
constexpr double kLeastLoad_kg_m2 = 1e-5;

// A speed less what friction takes of it, which is never more than all.
double rubbed(double speed, double most) noexcept {
  if (std::abs(speed) <= most) return 0;
  return speed > 0 ? speed - most : speed + most;
}

}  // namespace

LoadedDrive::LoadedDrive(const LoadedDriveConfig& c) noexcept : config_(c) {
  load_inertia_ = c.gap_rad > 0 ? std::max(c.load_kg_m2, kLeastLoad_kg_m2) : c.load_kg_m2;
  inertia_ = c.rotor_kg_m2 + load_inertia_ / (c.gear * c.gear);
  load_rad_ = c.start_rad;
  rotor_rad_ = c.start_rad * c.gear;
}

void LoadedDrive::command(const MotorCommand& c) noexcept {
  const bool stands = c.mode != ControllerMode::kPosition && c.mode != ControllerMode::kVelocity &&
                      c.mode != ControllerMode::kPwm && c.mode != ControllerMode::kCurrent;
  off_ = stands && (off_ || !config_.brakes);
  if (off_ || c.mode == ControllerMode::kCurrent) integral_rad_ = 0;
  command_ = c;
}

double LoadedDrive::velocity_loop(double wanted_rad_per_s, double dt_s) noexcept {
  const double error = wanted_rad_per_s - rotor_rad_per_s_;
  const double per_rad_per_s = inertia_ / config_.torque_Nm_per_A;
  const double limit = config_.current_limit_A;
  const double whole = per_rad_per_s * kLoop_rad_per_s *
                       (2 * error + kLoop_rad_per_s * (integral_rad_ + error * dt_s));
  // At its limit the loop remembers no more of what it can not give.
  if (std::abs(whole) <= limit || whole * error < 0) integral_rad_ += error * dt_s;
  return std::clamp(whole, -limit, limit);
}

double LoadedDrive::wanted_A(double dt_s) noexcept {
  const IdealMotorConfig& k = config_.control;
  if (off_) return 0;
  double rpm = 0;
  switch (command_.mode) {
    case ControllerMode::kCurrent: {
      // The supply's voltage ends what a current can accelerate.
      const double amps = 1e-3 * command_.value;
      const double top = k.velocity_limit_rpm * kRad_per_s_per_rpm;
      if (amps * rotor_rad_per_s_ > 0 && std::abs(rotor_rad_per_s_) >= top) return 0;
      return std::clamp(amps, -config_.current_limit_A, config_.current_limit_A);
    }
    case ControllerMode::kVelocity:
      rpm = command_.value;
      break;
    case ControllerMode::kPosition: {
      const double ticks = rotor_rad_ / (2 * std::numbers::pi) * k.ticks_per_turn;
      rpm = k.position_gain_per_s * (command_.value - ticks) * 60 / k.ticks_per_turn;
      break;
    }
    case ControllerMode::kPwm:
      rpm = k.rpm_per_duty * command_.value;
      break;
    default:
      break;
  }
  rpm = std::clamp(rpm, -k.velocity_limit_rpm, k.velocity_limit_rpm);
  return velocity_loop(rpm * kRad_per_s_per_rpm, dt_s);
}

bool LoadedDrive::warm(double dt_s) noexcept {
  if (config_.rated_A <= 0) return false;
  const double goal = current_A_ * current_A_;
  heat_A2_ += (goal - heat_A2_) * -std::expm1(-dt_s / config_.thermal_s);
  const double most = config_.rated_A * config_.rated_A;
  if (heat_A2_ < most || goal < most || off_) return false;
  off_ = true;
  integral_rad_ = 0;
  command_ = {};
  return true;
}

bool LoadedDrive::step(double dt_s, double load_Nm) noexcept {
  const double wanted = wanted_A(dt_s);
  if (config_.current_loop_s > 0)
    current_A_ += (wanted - current_A_) * -std::expm1(-dt_s / config_.current_loop_s);
  else
    current_A_ = wanted;
  const bool tripped = warm(dt_s);
  const double torque = config_.torque_Nm_per_A * current_A_;
  if (config_.gap_rad <= 0 || flank_ != 0)
    move_together(torque, load_Nm, dt_s);
  else
    move_apart(torque, load_Nm, dt_s);
  stop_at_end();
  return tripped;
}

double LoadedDrive::load_alone(double load_Nm, double dt_s) const noexcept {
  return rubbed(load_rad_per_s_ + dt_s * load_Nm / load_inertia_,
                dt_s * config_.load_coulomb_Nm / load_inertia_);
}

void LoadedDrive::move_together(double torque_Nm, double load_Nm, double dt_s) noexcept {
  const double gear = config_.gear;
  const double friction = config_.coulomb_Nm + config_.load_coulomb_Nm / gear;
  const double pushed = rotor_rad_per_s_ + dt_s * (torque_Nm + load_Nm / gear) / inertia_;
  const double speed =
      rubbed(pushed, dt_s * friction / inertia_) / (1 + dt_s * config_.viscous_Nm_s / inertia_);
  if (config_.gap_rad > 0 && flank_ * (speed / gear - load_alone(load_Nm, dt_s)) < 0) {
    flank_ = 0;  // the load would be pulled, and a flank can not
    return move_apart(torque_Nm, load_Nm, dt_s);
  }
  rotor_rad_ += dt_s * (rotor_rad_per_s_ + speed) / 2;
  rotor_rad_per_s_ = speed;
  load_rad_per_s_ = speed / gear;
  load_rad_ = rotor_rad_ / gear - flank_ * config_.gap_rad / 2;
}

void LoadedDrive::move_apart(double torque_Nm, double load_Nm, double dt_s) noexcept {
  const double rotor = config_.rotor_kg_m2;
  const double pushed = rotor_rad_per_s_ + dt_s * torque_Nm / rotor;
  const double speed =
      rubbed(pushed, dt_s * config_.coulomb_Nm / rotor) / (1 + dt_s * config_.viscous_Nm_s / rotor);
  const double load = load_alone(load_Nm, dt_s);
  rotor_rad_ += dt_s * (rotor_rad_per_s_ + speed) / 2;
  load_rad_ += dt_s * (load_rad_per_s_ + load) / 2;
  rotor_rad_per_s_ = speed;
  load_rad_per_s_ = load;
  meet();
}

void LoadedDrive::meet() noexcept {
  const double gear = config_.gear;
  const double ahead = rotor_rad_ / gear - load_rad_;
  if (std::abs(ahead) < config_.gap_rad / 2) return;
  flank_ = ahead > 0 ? 1 : -1;
  const double momentum =
      config_.rotor_kg_m2 * rotor_rad_per_s_ + load_inertia_ * load_rad_per_s_ / gear;
  rotor_rad_per_s_ = momentum / inertia_;
  load_rad_per_s_ = rotor_rad_per_s_ / gear;
  load_rad_ = rotor_rad_ / gear - flank_ * config_.gap_rad / 2;
}

void LoadedDrive::stop_at_end() noexcept {
  const bool high = load_rad_ >= config_.high_stop_rad && load_rad_per_s_ > 0;
  const bool low = load_rad_ <= config_.low_stop_rad && load_rad_per_s_ < 0;
  if (!high && !low) return;
  load_rad_ = high ? config_.high_stop_rad : config_.low_stop_rad;
  load_rad_per_s_ = 0;
  // A rotor that does not push into the stop goes on through its gap.
  if (config_.gap_rad > 0 && flank_ != (high ? 1 : -1)) {
    flank_ = 0;
    return;
  }
  rotor_rad_ = (load_rad_ + flank_ * config_.gap_rad / 2) * config_.gear;
  rotor_rad_per_s_ = 0;
}

MotorMotion LoadedDrive::motion() const noexcept {
  return {rotor_rad_ / (2 * std::numbers::pi) * config_.control.ticks_per_turn,
          rotor_rad_per_s_ / kRad_per_s_per_rpm, 1e3 * current_A_};
}

}  // namespace drivers::youbot_bus
