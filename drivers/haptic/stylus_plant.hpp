// The stylus of a simulated haptic device, with a hand on it.
//
// Mechanics  A point mass (device + hand) with viscous and Coulomb friction in D; the hand is a
//            spring and damper toward the scripted target. Integrated on a fixed grid of sub-steps;
//            within a sub-step the linear part is exact (matrix exponential, computed at set-up),
//            so without Coulomb friction the motion between ticks is exact, as the stability sweeps
//            need. The result does not depend on who asks or which clock runs.
// Motors     hold() holds its force until the next one (zero-order hold), after `delay_s`.
// Frame D haptic base.  SI.  One owner thread.
#pragma once

#include <array>
#include <cstdint>

#include "drivers/haptic/hand_script.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace drivers {

struct StylusPlantConfig {
  double mass_kg = 0.2;
  double damping_N_s_per_m = 2.0;
  double coulomb_N = 0.1;
  double delay_s = 0.0;
  double workspace_radius_m = 0.075;
  double brake_damping_N_s_per_m = 15.0;  // with the motor windings shorted
  double gravity_mass_kg = 0.0;           // weight of the arm
  double hand_mass_kg = 0.2;
  double hand_stiffness_N_per_m = 400.0;  // 0: nobody holds the stylus
  double hand_damping_N_s_per_m = 8.0;
  double end_stop_N_per_m = 5000.0;  // rim of the workspace
  int substep_us = 50;
};

class StylusPlant {
 public:
  struct Motors {
    bool on = true;        // the held force acts
    bool shorted = false;  // they brake
    perception::Vec3 bias_N = perception::Vec3::Zero();
  };

  // `hand` may be null: nobody holds the stylus. It must outlive the plant.
  // Throws std::invalid_argument if the start lies outside the workspace or the delay is too long.
  StylusPlant(const StylusPlantConfig&, HandScript* hand, const perception::Vec3& start_p_DH);

  // The hand's script starts at the first access, or here.
  void start_hand(rt::Time now) noexcept;
  // Time begins; later calls do nothing.
  void begin(rt::Time now) noexcept;
  // There is a sub-step to do until `now`.
  [[nodiscard]] bool behind(rt::Time now) const noexcept {
    return steps_ < (now - epoch_).count() / step_ns_.count();
  }
  // One sub-step: take_force() makes the force of its instant the held one, then step() moves.
  void take_force() noexcept;
  void step(const Motors& motors) noexcept;
  // All sub-steps until `now`, motors on.
  void advance(rt::Time now) noexcept;

  // The force from `now` + delay on, until the next one.
  void hold(rt::Time now, const perception::Vec3& f_D) noexcept;
  // No force, and none on its way.
  void drop_force() noexcept;

  // Sub-steps since the beginning.
  [[nodiscard]] std::int64_t steps() const noexcept { return steps_; }
  [[nodiscard]] rt::Nanos step_ns() const noexcept { return step_ns_; }
  [[nodiscard]] bool held() const noexcept {
    return hand_ != nullptr && config_.hand_stiffness_N_per_m > 0;
  }
  [[nodiscard]] const perception::Vec3& true_position() const noexcept { return x_; }
  [[nodiscard]] const perception::Vec3& true_velocity() const noexcept { return v_; }
  [[nodiscard]] const perception::Vec3& motor_force() const noexcept { return force_; }
  [[nodiscard]] const HandTarget& hand_target() const noexcept { return target_; }
  // Kicks the mass (tests): adds to the velocity.
  void push(const perception::Vec3& dv) noexcept { v_ += dv; }
  // A steady force of the outside on the tip, N in D (tests and sweeps).
  void set_external_force(const perception::Vec3& f) noexcept { external_ = f; }

 private:
  // x' = phi(0,0) x + phi(0,1) v + phi(0,2) u, v' likewise: exact for a constant force u.
  struct Transition {
    double xx = 1, xv = 0, xu = 0, vx = 0, vv = 1, vu = 0;
  };
  struct Pending {
    std::int64_t step = 0;
    perception::Vec3 force = perception::Vec3::Zero();
  };
  [[nodiscard]] static Transition transition(double m, double b, double k, double h);
  void next_force() noexcept;
  void move(const Transition&, const perception::Vec3& u, const perception::Vec3& offset) noexcept;

  StylusPlantConfig config_;
  HandScript* hand_;
  Transition free_, held_, braked_, braked_held_;
  rt::Nanos step_ns_;
  std::int64_t delay_steps_ = 0;

  bool started_ = false, hand_started_ = false;
  rt::Time epoch_{};
  rt::Nanos hand_offset_{0};  // script start after the epoch
  std::int64_t steps_ = 0;
  perception::Vec3 x_, v_ = perception::Vec3::Zero();
  perception::Vec3 force_ = perception::Vec3::Zero(), external_ = perception::Vec3::Zero();
  std::array<Pending, 64> pending_{};
  std::size_t pending_head_ = 0, pending_size_ = 0;
  HandTarget target_;
  perception::Vec3 target_D_ = perception::Vec3::Zero(), target_v_D_ = perception::Vec3::Zero();
};

}  // namespace drivers
