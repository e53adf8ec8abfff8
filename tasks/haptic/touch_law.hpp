// Rules of touch that a judge of the hard cases (docs/stability.md) is there for, one function
// each. The task asks `TouchRules` (touch_rules.hpp), which is this law. A test that must fail
// brings another touch_rules.hpp with one rule broken (tests/negative/haptic).
// Frames: W world, D haptic base.  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/bump_force.hpp"
#include "tasks/haptic/haptic_config.hpp"

namespace tasks {

struct Surface;  // tasks/haptic/effects.hpp

// How stiff a bump may be along the surface: what the device holds quietly, and no more than the
// slew guard lets through, since a force that comes late costs energy round a loop. At all of what
// the device renders stably, bumps that hold it take more than 3 s to come to rest; the guard is
// asked at the pace of a quick stroke, once, so that the reach is a length.
class BumpSide {
 public:
  // A stroke over the bumps. The law does not look at it.
  struct Stroke {
    const perception::Vec3& v_D;
    bool touched;  // in the last tick too
    const Surface& surface;
    double period_s;
  };

  BumpSide() = default;
  BumpSide(const HapticConfig& c, double stable_N_per_m) : N_per_m_(side_of(c, stable_N_per_m)) {}

  [[nodiscard]] double N_per_m() const noexcept { return N_per_m_; }
  // The same at this stroke.
  [[nodiscard]] double N_per_m(const Stroke&) const noexcept { return N_per_m_; }

 private:
  [[nodiscard]] static double side_of(const HapticConfig& c, double stable_N_per_m) noexcept {
    constexpr double kOfDevice = 0.75, kOfGuard = 0.8, kStroke_m_per_s = 0.1;
    const double most =
        c.texture_stiffness_N_per_m > 0 ? c.texture_stiffness_N_per_m : kOfDevice * stable_N_per_m;
    if (!c.guard) return most;
    const double k = c.stiffness_N_per_m;
    const double rate = std::min(c.slew_calm_N_per_s + 2 * std::max(k, 1000.0) * kStroke_m_per_s,
                                 std::max(c.slew_N_per_s, 1.1 * k * kStroke_m_per_s));
    return std::min(most, kOfGuard * rate / kStroke_m_per_s);
  }

  double N_per_m_ = 0;
};

struct TouchLaw {
  // The effects are built in; without them a task costs what it costs at least.
  static constexpr bool kEffects = true;

  // A contact begins only by crossing from seen-free space into the solid.
  [[nodiscard]] static constexpr bool unknown_is_free() noexcept { return false; }
  // Distance that the proxy keeps where the field rises by `slope` over a length.
  [[nodiscard]] static constexpr double tip_radius_m(double radius_m, double slope) noexcept {
    return radius_m * slope;
  }

  // The clutch fades the force out as a ramp-down does, and nothing behind the slew guard changes
  // what it let through; meanwhile the hand in the scene stands.
  [[nodiscard]] static constexpr bool clutch_fades(bool clutch) noexcept { return clutch; }
  [[nodiscard]] static constexpr bool clutch_holds_hand(bool clutch) noexcept { return clutch; }
  [[nodiscard]] static const perception::Vec3& behind_guard(const perception::Vec3& f_D,
                                                            bool /*clutch*/) noexcept {
    return f_D;
  }

  // Friction: the anchor rests where it is, and the proxy breaks loose at the rim of rest.
  [[nodiscard]] static const perception::Vec3& anchor_W(const perception::Vec3& anchor_W,
                                                        const perception::Vec3& /*p_c*/) noexcept {
    return anchor_W;
  }
  [[nodiscard]] static constexpr double mu_of_rest(double mu_static,
                                                   double /*mu_dynamic*/) noexcept {
    return mu_static;
  }

  // Texture: a bump is as high as the pattern says, and a height unless the published normal was
  // asked for.
  using Side = BumpSide;
  [[nodiscard]] static constexpr double bump_height_m(double height_m) noexcept { return height_m; }
  [[nodiscard]] static constexpr bool bump_is_normal(bool asked) noexcept { return asked; }
  [[nodiscard]] static BumpForce bump_force(double bump_m, double deep_m, double reach_m) noexcept {
    return tasks::bump_force(bump_m, deep_m, reach_m);
  }
};

}  // namespace tasks
