#include "drivers/haptic/stylus_plant.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "rt/effect_count.hpp"

namespace drivers {

using perception::Vec3;

StylusPlant::StylusPlant(const StylusPlantConfig& c, HandScript* hand, const Vec3& start_p_DH)
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
  const double held = c.mass_kg + c.hand_mass_kg;
  const double brake = c.damping_N_s_per_m + c.brake_damping_N_s_per_m;
  free_ = transition(c.mass_kg, c.damping_N_s_per_m, 0, h);
  braked_ = transition(c.mass_kg, brake, 0, h);
  held_ =
      transition(held, c.damping_N_s_per_m + c.hand_damping_N_s_per_m, c.hand_stiffness_N_per_m, h);
  braked_held_ = transition(held, brake + c.hand_damping_N_s_per_m, c.hand_stiffness_N_per_m, h);
  using rt::Effect;
  if (c.coulomb_N > 0) rt::effect_built(Effect::kDeviceFriction);
  if (delay_steps_ > 0) rt::effect_built(Effect::kDeviceDelay);
  if (c.gravity_mass_kg > 0) rt::effect_built(Effect::kGravity);
  if (StylusPlant::held()) rt::effect_built(Effect::kHand);
}

// exp of [[0 1 0] [-k/m -b/m 1/m] [0 0 0]] h by its series with scaling and squaring.
StylusPlant::Transition StylusPlant::transition(double m, double b, double k, double h) {
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

void StylusPlant::begin(rt::Time now) noexcept {
  if (started_) return;
  started_ = true;
  epoch_ = now;
  hand_started_ = true;
}

void StylusPlant::start_hand(rt::Time now) noexcept {
  advance(now);
  hand_offset_ = step_ns_ * steps_;
  hand_started_ = true;
}

void StylusPlant::advance(rt::Time now) noexcept {
  begin(now);
  while (behind(now)) {
    take_force();
    step({});
  }
}

void StylusPlant::hold(rt::Time now, const Vec3& f_D) noexcept {
  Pending p;
  const std::int64_t since = (now - epoch_).count();
  p.step = (since + step_ns_.count() - 1) / step_ns_.count() + delay_steps_;
  if (delay_steps_ > 0) rt::effect_ran(rt::Effect::kDeviceDelay);
  p.force = f_D;
  if (pending_size_ == pending_.size()) next_force();
  pending_[(pending_head_ + pending_size_) % pending_.size()] = p;
  ++pending_size_;
}

void StylusPlant::drop_force() noexcept {
  force_.setZero();
  pending_size_ = 0;
}

void StylusPlant::next_force() noexcept {
  force_ = pending_[pending_head_].force;
  pending_head_ = (pending_head_ + 1) % pending_.size();
  --pending_size_;
}

void StylusPlant::take_force() noexcept {
  while (pending_size_ > 0 && pending_[pending_head_].step <= steps_) next_force();
}

void StylusPlant::step(const Motors& motors) noexcept {
  constexpr double kGravity = 9.81;
  Vec3 u = external_ + motors.bias_N;
  if (motors.on) u += force_;
  if (config_.gravity_mass_kg > 0) {
    rt::effect_ran(rt::Effect::kGravity);
    u.z() -= config_.gravity_mass_kg * kGravity;
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
  if (held()) {
    rt::effect_ran(rt::Effect::kHand);
    // Solved relative to the target, so the hand's spring is inside the exact part.
    u += config_.hand_damping_N_s_per_m * target_v_D_;
    move(motors.shorted ? braked_held_ : held_, u, target_D_);
  } else {
    move(motors.shorted ? braked_ : free_, u, Vec3::Zero());
  }
  ++steps_;
}

// One sub-step under the constant force u, positions relative to `offset`. Coulomb friction acts
// against the velocity at its start, sticks below its limit, and never turns the motion round.
void StylusPlant::move(const Transition& t, const Vec3& u, const Vec3& offset) noexcept {
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

}  // namespace drivers
