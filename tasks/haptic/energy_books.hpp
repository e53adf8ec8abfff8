// The books of the spring's energy: what hand, surface, fades and device put in and take out
// (energy.hpp), and the controller that pays back what nobody paid for (passivity.hpp).
// Frames: W world, D haptic base.  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <cstdint>

#include "drivers/haptic/haptic_device.hpp"
#include "perception/geometry/pose.hpp"
#include "tasks/haptic/contact.hpp"
#include "tasks/haptic/energy.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/haptic_config.hpp"
#include "tasks/haptic/passivity.hpp"
#include "tasks/haptic/spring.hpp"

namespace tasks {

class EnergyBooks {
 public:
  // What may have moved beside the hand.
  enum class Mover : std::uint8_t { kHand, kSurface, kMore };
  // The spring of a tick, as the device has it.
  struct Entry {
    const Spring& spring;
    const perception::Vec3& elastic_D;  // its force without friction, not limited
    const perception::Vec3& dx_D;       // of the hand since the last tick
    double gain;
    double stiffness_N_per_m;  // K of this tick
    Mover mover;
    double dt;
  };

  EnergyBooks() = default;
  EnergyBooks(const HapticConfig& c, const drivers::DeviceProperties& device, double force_limit_N,
              double period_s)
      : passivity_(device.mass_kg, device.quantum_m, period_s),
        credit_N_s_per_m_(kOfDamping * (c.credit_N_s_per_m >= 0 ? c.credit_N_s_per_m
                                        : device.damping_known  ? device.damping_N_s_per_m
                                                                : 0.0)),
        force_limit_N_(force_limit_N),
        scale_(c.scale),
        controller_(c.passivity_controller) {}

  [[nodiscard]] const EnergyObserver& observer() const noexcept { return energy_; }
  // The spring's part of the last tick's force.
  [[nodiscard]] const perception::Vec3& elastic_D() const noexcept { return f_elastic_D_; }
  // Blend and fade go at this share of their pace: less than 1 beyond what may be put into the
  // spring.
  [[nodiscard]] double pace() const noexcept { return energy_.over_budget() ? kSlowed : 1.0; }

  void begin_event() noexcept { energy_.begin_event(); }
  // The hand moved under the force that was sent last.
  void move(const perception::Vec3& f_sent_D, const perception::Vec3& dx_D, double dt) noexcept {
    energy_.move(f_sent_D, dx_D);
    energy_.credit(credit_N_s_per_m_ * dx_D.squaredNorm() / dt);
  }
  // Where the hand is; forget_hand(): it is not to be connected with where it was.
  void see(const perception::Vec3& p_DH) noexcept {
    if (controller_) passivity_.see(p_DH);
  }
  void forget_hand() noexcept { passivity_.forget(); }

  // Energy that the surface, a fade or a moving workspace put into the spring: what it holds more
  // than the hand's motion against its own force explains. Friction, viscosity and the controller
  // only take energy out, so they have no part in it.
  // A proxy that slips over an edge or lets go loses what its spring held. That is dissipated:
  // credit the surface only with the work of its own retreat.
  void book(const Entry& e, const Contact& contact, const Field& field) noexcept {
    const perception::Vec3 before = f_elastic_D_;
    f_elastic_D_ = e.spring.contact ? limited(e.elastic_D, force_limit_N_)
                                    : perception::Vec3(perception::Vec3::Zero());
    const double spring_J =
        e.gain > 0 && e.spring.contact
            ? e.gain * spring_energy(e.stiffness_N_per_m, e.spring.length_m / scale_,
                                     force_limit_N_ / e.gain)
            : 0;
    double injected = e.mover != Mover::kHand
                          ? spring_J - spring_J_ + 0.5 * (before + f_elastic_D_).dot(e.dx_D)
                          : 0;
    if (injected < -kSlip_J && e.mover == Mover::kSurface) {
      const double back_m = contact.gone_back_m(field);
      injected = std::max(injected, -kSharpest * before.norm() * back_m / scale_);
    }
    energy_.book(injected, spring_J - spring_J_, e.dt);
    spring_J_ = spring_J;
  }
  // The force that may be sent instead of `f_D`, of this size before the force limit; in contact.
  // True: it was changed.
  bool make_passive(perception::Vec3& f_D, double size, const Entry& e) const noexcept {
    if (!controller_ || passivity_.idle(f_D, std::min(size, force_limit_N_), e.dx_D,
                                        energy_.reserve_J(), spring_J_, e.dt)) {
      return false;
    }
    f_D =
        passivity_.limited(f_D, e.dx_D, energy_.reserve_J(), spring_J_, e.stiffness_N_per_m, e.dt);
    return true;
  }
  // The force is off from here on.
  void off() noexcept {
    f_elastic_D_ = perception::Vec3::Zero();
    spring_J_ = 0;
  }

 private:
  // Blend and fade beyond what may be put into the spring.
  // chosen on: not recorded; judged on: stability 12, 13, 14, 17, 20
  static constexpr double kSlowed = 0.25;

  static constexpr double kOfDamping = 0.8;  // what is credited of the device's own (energy.hpp)
  static constexpr double kSlip_J = 1e-4;
  static constexpr double kSharpest =
      4;  // the apex of a crease goes so much farther than its faces

  // Energy of a spring whose force is cut at `limit`.
  [[nodiscard]] static double spring_energy(double stiffness, double stretch,
                                            double limit) noexcept {
    const double knee = limit / stiffness;
    return stretch <= knee ? 0.5 * stiffness * stretch * stretch
                           : 0.5 * stiffness * knee * knee + limit * (stretch - knee);
  }

  EnergyObserver energy_;
  PassivityController passivity_;
  perception::Vec3 f_elastic_D_ = perception::Vec3::Zero();
  double spring_J_ = 0;  // energy in the spring last tick
  double credit_N_s_per_m_ = 0, force_limit_N_ = 0, scale_ = 1;
  bool controller_ = true;
};

}  // namespace tasks
