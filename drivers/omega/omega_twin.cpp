#include "drivers/omega/omega_twin.hpp"

#include <cmath>
#include <limits>

#include "rt/effect_count.hpp"

namespace drivers {
namespace {

using perception::Vec3;

constexpr double kGravity_mps2 = 9.81;

Vec3 clipped(const Vec3& f, double limit) noexcept {
  const double n = f.norm();
  return n > limit ? Vec3(f * (limit / n)) : f;
}

}  // namespace

OmegaTwin::OmegaTwin(rt::NonRealtime&, const OmegaTwinConfig& c, HandScript* hand,
                     const Vec3& start_p_DH)
    : config_(c), plant_(c, hand, start_p_DH) {
  watchdog_steps_ = std::llround(c.watchdog_s / rt::seconds(plant_.step_ns()));
  using rt::Effect;
  if (c.quantum_m > 0) rt::effect_built(Effect::kQuantum);
  if (c.time_guard_s > 0) rt::effect_built(Effect::kTimeGuard);
  state_ = c.calibrated ? DeviceState::kIdle : DeviceState::kReset;
}

DeviceProperties OmegaTwin::properties() const noexcept {
  DeviceProperties p;
  p.mass_kg = config_.mass_kg;
  p.damping_N_s_per_m = config_.damping_N_s_per_m;
  p.coulomb_N = config_.coulomb_N;
  p.delay_s = config_.delay_s;
  p.quantum_m = config_.quantum_m;
  p.force_limit_N = config_.force_limit_N;
  p.workspace_radius_m = config_.workspace_radius_m;
  p.speed_limit_m_per_s = config_.speed_limit_m_per_s;
  p.measured = !config_.measured.empty();
  p.damping_known = true;
  return p;
}

bool OmegaTwin::sense(rt::Time now, StylusSample& out) noexcept {
  if (gate_.asked()) {
    advance(now);
    if (state_ == DeviceState::kReset || faults_.unplugged) {
      gate_.forget();
    } else if (gate_.take()) {
      switch_on();
    }
  }
  advance(now);
  if (faults_.unplugged) return false;
  const bool guarded = config_.time_guard_s > 0 && sampled_ &&
                       now - last_sample_.taken < rt::nanos_from_seconds(config_.time_guard_s);
  if (config_.time_guard_s > 0) rt::effect_ran(rt::Effect::kTimeGuard);
  if (sampled_ && (guarded || faults_.repeat > 0)) {
    if (!guarded) --faults_.repeat;
    ++repeats_;
    out = last_sample_;
    out.repeated = true;
    out.state = state_;
    return true;
  }
  Vec3 p = plant_.true_position();
  if (faults_.frozen) {
    if (!was_frozen_) frozen_at_ = p;
    p = frozen_at_;
  }
  was_frozen_ = faults_.frozen;
  if (config_.quantum_m > 0) {
    rt::effect_ran(rt::Effect::kQuantum);
    for (int i = 0; i < 3; ++i) p[i] = std::round(p[i] / config_.quantum_m) * config_.quantum_m;
  }
  p += faults_.jump_m;
  if (faults_.nan_position) p.setConstant(std::numeric_limits<double>::quiet_NaN());
  last_sample_.seq = ++seq_;
  last_sample_.taken = now;
  last_sample_.p_DH = p;
  last_sample_.button = plant_.hand_target().button || faults_.stuck_button;
  last_sample_.clutch = plant_.hand_target().clutch;
  last_sample_.state = state_;
  last_sample_.repeated = false;
  sampled_ = true;
  out = last_sample_;
  return true;
}

void OmegaTwin::act(rt::Time now, const ForceCommand& command) noexcept {
  advance(now);
  if (faults_.unplugged) return;
  if (faults_.drop_commands > 0) {
    --faults_.drop_commands;
    return;
  }
  last_command_step_ = plant_.steps();
  if (state_ == DeviceState::kIdle) {
    state_ = DeviceState::kForce;  // the first command switches the motors on
    cause_ = ForceOffCause::kNone;
  }
  if (state_ != DeviceState::kForce) return;
  // The driver's part: gravity is compensated on the host, and the sum saturates.
  Vec3 f = command.f_H_D.allFinite() ? command.f_H_D : Vec3::Zero();
  f.z() += config_.gravity_mass_kg * kGravity_mps2;
  plant_.hold(now, clipped(f, config_.force_limit_N));
}

void OmegaTwin::start_hand(rt::Time now) noexcept {
  advance(now);
  plant_.start_hand(now);
}

bool OmegaTwin::enable_force(rt::Time now) noexcept {
  advance(now);
  if (state_ == DeviceState::kReset || faults_.unplugged) return false;
  gate_.ask();
  if (!gate_.take()) return false;  // made safe just now
  switch_on();
  return true;
}

void OmegaTwin::switch_on() noexcept {
  state_ = DeviceState::kForce;
  cause_ = ForceOffCause::kNone;
  plant_.drop_force();
  last_command_step_ = plant_.steps();
}

void OmegaTwin::disable_force(rt::Time now) noexcept {
  advance(now);
  brake(ForceOffCause::kSoftware);
}

void OmegaTwin::calibrate() noexcept {
  if (state_ == DeviceState::kReset) state_ = DeviceState::kIdle;
}

void OmegaTwin::set_watchdog(rt::Nanos after) noexcept {
  watchdog_steps_ = after.count() / plant_.step_ns().count();
}

void OmegaTwin::brake(ForceOffCause cause) noexcept {
  plant_.drop_force();
  if (state_ == DeviceState::kBrake || state_ == DeviceState::kReset) return;
  state_ = DeviceState::kBrake;
  cause_ = cause;
  ++brakes_;
}

void OmegaTwin::advance(rt::Time now) noexcept {
  const std::int64_t cpu = cpu_clock_ != nullptr ? cpu_clock_() : 0;
  plant_.begin(now);
  if (faults_.force_button) {
    faults_.force_button = false;
    brake(ForceOffCause::kButton);
  }
  if (faults_.lose_calibration) {
    faults_.lose_calibration = false;
    brake(ForceOffCause::kSoftware);
    state_ = DeviceState::kReset;
  }
  if (faults_.unplugged) brake(ForceOffCause::kDisconnect);
  if (gate_.safe()) brake(ForceOffCause::kSoftware);
  while (plant_.behind(now)) {
    plant_.take_force();
    supervise();
    const bool on = state_ == DeviceState::kForce;
    plant_.step({on, !on && state_ != DeviceState::kIdle, faults_.force_bias_N});
  }
  if (cpu_clock_ != nullptr) twin_cpu_ns_ += cpu_clock_() - cpu;
}

void OmegaTwin::supervise() noexcept {
  if (state_ != DeviceState::kForce) return;
  if (plant_.true_velocity().norm() > config_.speed_limit_m_per_s) {
    brake(ForceOffCause::kVelocity);
  } else if (plant_.steps() - last_command_step_ > watchdog_steps_) {
    brake(ForceOffCause::kWatchdog);
  }
}

std::vector<std::string> OmegaTwin::effects() const {
  std::vector<std::string> names;
  if (config_.coulomb_N > 0) names.emplace_back("device_friction");
  if (config_.quantum_m > 0) names.emplace_back("position_quantum");
  if (config_.delay_s > 0) names.emplace_back("device_delay");
  if (config_.time_guard_s > 0) names.emplace_back("time_guard");
  if (config_.gravity_mass_kg > 0) names.emplace_back("gravity");
  if (plant_.held()) names.emplace_back("hand");
  return names;
}

}  // namespace drivers
