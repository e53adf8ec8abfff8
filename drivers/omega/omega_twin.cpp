#include "drivers/omega/omega_twin.hpp"
#include "rt/effect_count.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

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
    : config_(c), hand_(hand), step_ns_(std::chrono::microseconds{c.substep_us}), x_(start_p_DH) {
  if (!start_p_DH.allFinite() || start_p_DH.norm() > c.workspace_radius_m) {
    throw std::invalid_argument("device twin: the start lies outside workspace_radius_m = " +
                                std::to_string(c.workspace_radius_m));
  }
  const double h = rt::seconds(step_ns_);
  const double delay = c.delay_s / h;
  if (std::llround(std::ceil(delay - 1e-9)) >= static_cast<std::int64_t>(pending_.size()) * 20) {
    throw std::invalid_argument("device twin: delay_s = " + std::to_string(c.delay_s) +
                                " is too long");
  }
  delay_steps_ = std::llround(std::ceil(delay - 1e-9));
  watchdog_steps_ = std::llround(c.watchdog_s / h);
  const double held = c.mass_kg + c.hand_mass_kg;
  const double brake = c.damping_N_s_per_m + c.brake_damping_N_s_per_m;
  free_ = transition(c.mass_kg, c.damping_N_s_per_m, 0, h);
  braked_ = transition(c.mass_kg, brake, 0, h);
  held_ =
      transition(held, c.damping_N_s_per_m + c.hand_damping_N_s_per_m, c.hand_stiffness_N_per_m, h);
  braked_held_ = transition(held, brake + c.hand_damping_N_s_per_m, c.hand_stiffness_N_per_m, h);
  using rt::Effect;
  if (c.coulomb_N > 0) rt::effect_built(Effect::kDeviceFriction);
  if (c.quantum_m > 0) rt::effect_built(Effect::kQuantum);
  if (delay_steps_ > 0) rt::effect_built(Effect::kDeviceDelay);
  if (c.time_guard_s > 0) rt::effect_built(Effect::kTimeGuard);
  if (c.gravity_mass_kg > 0) rt::effect_built(Effect::kGravity);
  if (hand != nullptr && c.hand_stiffness_N_per_m > 0) rt::effect_built(Effect::kHand);
  state_ = c.calibrated ? DeviceState::kIdle : DeviceState::kReset;
}

// exp of [[0 1 0] [-k/m -b/m 1/m] [0 0 0]] h by its series with scaling and squaring.
OmegaTwin::Transition OmegaTwin::transition(double m, double b, double k, double h) {
  Eigen::Matrix3d A;
  A << 0, h, 0, -k / m * h, -b / m * h, h / m, 0, 0, 0;
  int halvings = 0;
  while (A.cwiseAbs().rowwise().sum().maxCoeff() > 0.125) {
    A *= 0.5;
    ++halvings;
  }
  Eigen::Matrix3d E = Eigen::Matrix3d::Identity(), term = E;
  for (int n = 1; n <= 16; ++n) {
    term = Eigen::Matrix3d(term * A) / n;
    E += term;
  }
  for (int i = 0; i < halvings; ++i) E = Eigen::Matrix3d(E * E);
  return {E(0, 0), E(0, 1), E(0, 2), E(1, 0), E(1, 1), E(1, 2)};
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
  Vec3 p = x_;
  if (faults_.frozen) {
    if (!was_frozen_) frozen_at_ = x_;
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
  last_sample_.button = target_.button || faults_.stuck_button;
  last_sample_.clutch = target_.clutch;
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
  last_command_step_ = steps_;
  if (state_ == DeviceState::kIdle) {
    state_ = DeviceState::kForce;  // the first command switches the motors on
    cause_ = ForceOffCause::kNone;
  }
  if (state_ != DeviceState::kForce) return;
  // The driver's part: gravity is compensated on the host, and the sum saturates.
  Vec3 f = command.f_H_D.allFinite() ? command.f_H_D : Vec3::Zero();
  f.z() += config_.gravity_mass_kg * kGravity_mps2;
  Pending p;
  const std::int64_t since = (now - epoch_).count();
  p.step = (since + step_ns_.count() - 1) / step_ns_.count() + delay_steps_;
  if (delay_steps_ > 0) rt::effect_ran(rt::Effect::kDeviceDelay);
  p.force = clipped(f, config_.force_limit_N);
  if (pending_size_ == pending_.size()) {
    force_ = pending_[pending_head_].force;
    pending_head_ = (pending_head_ + 1) % pending_.size();
    --pending_size_;
  }
  pending_[(pending_head_ + pending_size_) % pending_.size()] = p;
  ++pending_size_;
}

void OmegaTwin::start_hand(rt::Time now) noexcept {
  advance(now);
  hand_offset_ = step_ns_ * steps_;
  hand_started_ = true;
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
  force_.setZero();
  pending_size_ = 0;
  last_command_step_ = steps_;
}

void OmegaTwin::disable_force(rt::Time now) noexcept {
  advance(now);
  brake(ForceOffCause::kSoftware);
}

void OmegaTwin::calibrate() noexcept {
  if (state_ == DeviceState::kReset) state_ = DeviceState::kIdle;
}

void OmegaTwin::set_watchdog(rt::Nanos after) noexcept {
  watchdog_steps_ = after.count() / step_ns_.count();
}

void OmegaTwin::brake(ForceOffCause cause) noexcept {
  force_.setZero();
  pending_size_ = 0;
  if (state_ == DeviceState::kBrake || state_ == DeviceState::kReset) return;
  state_ = DeviceState::kBrake;
  cause_ = cause;
  ++brakes_;
}

void OmegaTwin::advance(rt::Time now) noexcept {
  const std::int64_t cpu = cpu_clock_ != nullptr ? cpu_clock_() : 0;
  if (!started_) {
    started_ = true;
    epoch_ = now;
    hand_started_ = true;
  }
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
  const std::int64_t target = (now - epoch_).count() / step_ns_.count();
  while (steps_ < target) substep();
  if (cpu_clock_ != nullptr) twin_cpu_ns_ += cpu_clock_() - cpu;
}

void OmegaTwin::apply_pending() noexcept {
  while (pending_size_ > 0 && pending_[pending_head_].step <= steps_) {
    force_ = pending_[pending_head_].force;
    pending_head_ = (pending_head_ + 1) % pending_.size();
    --pending_size_;
  }
}

void OmegaTwin::substep() noexcept {
  apply_pending();
  supervise();
  const bool shorted = state_ != DeviceState::kForce && state_ != DeviceState::kIdle;
  const bool holding = hand_ != nullptr && config_.hand_stiffness_N_per_m > 0;
  Vec3 u = external_ + faults_.force_bias_N;
  if (state_ == DeviceState::kForce) u += force_;
  if (config_.gravity_mass_kg > 0) {
    rt::effect_ran(rt::Effect::kGravity);
    u.z() -= config_.gravity_mass_kg * kGravity_mps2;
  }
  const double reach = x_.norm();
  if (reach > config_.workspace_radius_m) {
    u -= (config_.end_stop_N_per_m * (reach - config_.workspace_radius_m) / reach) * x_;
  }
  if (hand_ != nullptr) {
    // The target at the middle of the sub-step stands for all of it.
    const rt::Nanos at = step_ns_ * steps_ + step_ns_ / 2 - hand_offset_;
    target_ = hand_->target(hand_started_ ? std::max(at, rt::Nanos{0}) : rt::Nanos{0});
    target_D_ = hand_->map().to_device(target_.p_WT);
    target_v_D_ = hand_->map().direction_to_device(target_.v_WT) / hand_->map().scale();
  }
  if (holding) {
    rt::effect_ran(rt::Effect::kHand);
    // Solved relative to the target, so the hand's spring is inside the exact part.
    u += config_.hand_damping_N_s_per_m * target_v_D_;
    move(shorted ? braked_held_ : held_, u, target_D_);
  } else {
    move(shorted ? braked_ : free_, u, Vec3::Zero());
  }
  ++steps_;
}

// One sub-step under the constant force u, positions relative to `offset`. Coulomb friction acts
// against the velocity at its start, sticks below its limit, and never turns the motion round.
void OmegaTwin::move(const Transition& t, const Vec3& u, const Vec3& offset) noexcept {
  Vec3 force = u;
  const double c = config_.coulomb_N;
  if (c > 0) {
    rt::effect_ran(rt::Effect::kDeviceFriction);
    const double speed = v_.norm();
    if (speed > 0) {
      force -= (c / speed) * v_;
    } else {
      // At rest: the sum of all forces on the mass, spring included, must exceed the limit.
      const Vec3 spring = (&t == &held_ || &t == &braked_held_)
                              ? Vec3(config_.hand_stiffness_N_per_m * (offset - x_))
                              : Vec3(Vec3::Zero());
      const Vec3 all = u + spring;
      const double size = all.norm();
      if (size <= c) return;
      force -= (c / size) * all;
    }
  }
  const Vec3 x = x_ - offset, v = v_;
  x_ = offset + t.xx * x + t.xv * v + t.xu * force;
  v_ = t.vx * x + t.vv * v + t.vu * force;
  if (c > 0 && v.squaredNorm() > 0 && v_.dot(v) <= 0) v_.setZero();
}

void OmegaTwin::supervise() noexcept {
  if (state_ != DeviceState::kForce) return;
  if (v_.norm() > config_.speed_limit_m_per_s) {
    brake(ForceOffCause::kVelocity);
  } else if (steps_ - last_command_step_ > watchdog_steps_) {
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
  if (hand_ != nullptr && config_.hand_stiffness_N_per_m > 0) names.emplace_back("hand");
  return names;
}

}  // namespace drivers
