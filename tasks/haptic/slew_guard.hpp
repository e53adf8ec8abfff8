// How fast the force on the hand may change: the last guard before the device. It remembers the
// force of the last tick, before it and behind it.
//   limit    max(slew T, 1.1 K |dh|) a tick, and less under a hand that is nearly still: there a
//            change of the force thirty times a second is the noise of fusion. Where the surface
//            steps, or the size of the force is more than 1 N behind, the full rate counts.
// Frame: D haptic base.  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <cmath>

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/haptic_config.hpp"
#include "tasks/haptic/haptic_telemetry.hpp"
#include "tasks/haptic/spring.hpp"
#include "tasks/haptic/touch_rules.hpp"

namespace tasks {

class SlewGuard {
 public:
  struct Tick {
    const perception::Vec3& dx_D;  // of the hand since the last tick
    bool steps = false;            // the surface steps
    bool clutch = false;
  };

  SlewGuard() = default;
  SlewGuard(const HapticConfig& c, double force_limit_N, double period_s)
      : stiffness_N_per_m_(c.stiffness_N_per_m),
        slew_N_(c.slew_N_per_s * period_s),
        calm_N_(c.slew_calm_N_per_s * period_s),
        force_limit_N_(force_limit_N),
        on_(c.guard) {}

  // The force on the hand, behind the guard.
  [[nodiscard]] const perception::Vec3& f_D() const noexcept { return f_D_; }

  // The force that may be sent instead of `f_D`. Of `t` it reads in_contact and fills what the
  // guard did.
  const perception::Vec3& guard(const perception::Vec3& f_D, const Tick& tick,
                                HapticTelemetry& t) noexcept {
    const double dh = tick.dx_D.norm();
    perception::Vec3 f = f_D;
    t.f_raw_D = f;
    t.step_raw_N = (f - f_raw_D_).norm();
    t.guard_use = t.in_contact && t.step_raw_N > stiffness_N_per_m_ * dh + 0.1;
    f_raw_D_ = f;
    const perception::Vec3 change = f - f_D_;
    const double size = change.norm(), most = limit(change, dh, tick.steps);
    if (on_ && size > most) {
      f = f_D_ + change * (most / size);
      t.guard_active = true;
    }
    f = limited(f, force_limit_N_);
    t.step_N = (f - f_D_).norm();
    f_D_ = TouchRules::behind_guard(f, tick.clutch);
    return f_D_;
  }
  // The force is off from here on.
  void off() noexcept { f_D_ = f_raw_D_ = perception::Vec3::Zero(); }

 private:
  [[nodiscard]] double limit(const perception::Vec3& change, double dh, bool steps) const noexcept {
    // Least stiffness used here: with a soft spring a moving hand must not count as still.
    constexpr double kCalmRise_N_per_m = 1000;
    const double moved = stiffness_N_per_m_ * dh;
    const double most = std::max(slew_N_, 1.1 * moved);
    if (steps) return most;
    const double calm = std::min(calm_N_ + 2 * std::max(moved, kCalmRise_N_per_m * dh), most);
    const double size = f_D_.norm();
    const double along = size > 0.1 ? std::abs(change.dot(f_D_)) / size : change.norm();
    return calm + (most - calm) * std::clamp(along - 1.0, 0.0, 1.0);
  }

  double stiffness_N_per_m_ = 0;
  double slew_N_ = 0, calm_N_ = 0;  // in a tick
  double force_limit_N_ = 0;
  bool on_ = true;
  perception::Vec3 f_raw_D_ = perception::Vec3::Zero(), f_D_ = perception::Vec3::Zero();
};

}  // namespace tasks
