// The rules of touch, each broken on purpose when `broken_now` says so: the judges of the hard
// cases have to see it. In this target's include path the file stands before the product's of that
// name.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "tasks/haptic/effects.hpp"
#include "tasks/haptic/touch_law.hpp"

namespace tasks {

enum class Broken : std::uint8_t {
  kNone,
  kTouchesOutOfTheUnknown,  // a contact begins without seen-free space before it
  kClutchCutsForce,         // at once, behind the guard
  kClutchKeepsForce,
  kClutchMovesHand,     // the hand in the scene goes with the device
  kAnchorLeaks,         // friction: 0.1 % of the way a tick
  kBreaksLooseEarly,    // friction: at the dynamic rim
  kBumpsTooLow,         // 80 % of their height
  kReachFollowsSpeed,   // the bumps as they were: K D n at any depth, the part along the surface up
                        // to a reach of the pace
  kBumpsTurnTheNormal,  // the published perturbed normal, no height
  kTipWithoutRadius,    // in contact
};
inline Broken broken_now = Broken::kNone;
[[nodiscard]] inline bool broken(Broken b) noexcept { return broken_now == b; }

// As it was: the guard is asked at the hand's own pace, from 10 mm/s on, followed with 30 N/s.
class PacedSide : public BumpSide {
 public:
  PacedSide() = default;
  PacedSide(const HapticConfig& c, double stable_N_per_m)
      : BumpSide(c, stable_N_per_m),
        device_N_per_m_(0.75 * stable_N_per_m),
        spring_N_per_m_(c.stiffness_N_per_m),
        slew_N_per_s_(c.slew_N_per_s),
        slew_calm_N_per_s_(c.slew_calm_N_per_s),
        now_N_per_m_(BumpSide::N_per_m()) {}

  [[nodiscard]] double N_per_m() const noexcept { return now_N_per_m_; }
  [[nodiscard]] double N_per_m(const Stroke& s) noexcept {
    if (broken(Broken::kReachFollowsSpeed)) follow(s);
    return now_N_per_m_;
  }

 private:
  void follow(const Stroke& s) noexcept {
    const double v = std::max(s.v_D.norm(), 0.01), k = spring_N_per_m_;
    const double rate = std::min(slew_calm_N_per_s_ + 2 * std::max(k, 1000.0) * v,
                                 std::max(slew_N_per_s_, 1.1 * k * v));
    const double goal = std::min(device_N_per_m_, 0.8 * rate / v);
    const double most = s.touched ? 30 * s.period_s * s.surface.curvature_per_m() /
                                        std::max(s.surface.steepness(), 1e-12)
                                  : std::numeric_limits<double>::infinity();
    now_N_per_m_ += std::clamp(goal - now_N_per_m_, -most, most);
  }

  double device_N_per_m_ = 0, spring_N_per_m_ = 0, slew_N_per_s_ = 0, slew_calm_N_per_s_ = 0;
  double now_N_per_m_ = 0;
};

struct TouchRules : TouchLaw {
  [[nodiscard]] static bool unknown_is_free() noexcept {
    return broken(Broken::kTouchesOutOfTheUnknown);
  }
  [[nodiscard]] static double tip_radius_m(double radius_m, double slope) noexcept {
    return broken(Broken::kTipWithoutRadius) ? 0 : TouchLaw::tip_radius_m(radius_m, slope);
  }
  [[nodiscard]] static bool clutch_fades(bool clutch) noexcept {
    return clutch && !broken(Broken::kClutchKeepsForce);
  }
  [[nodiscard]] static bool clutch_holds_hand(bool clutch) noexcept {
    return clutch && !broken(Broken::kClutchMovesHand);
  }
  [[nodiscard]] static perception::Vec3 behind_guard(const perception::Vec3& f_D,
                                                     bool clutch) noexcept {
    return clutch && broken(Broken::kClutchCutsForce) ? perception::Vec3(perception::Vec3::Zero())
                                                      : f_D;
  }
  [[nodiscard]] static perception::Vec3 anchor_W(const perception::Vec3& anchor_W,
                                                 const perception::Vec3& p_c) noexcept {
    return broken(Broken::kAnchorLeaks) ? perception::Vec3(anchor_W + 1e-3 * (p_c - anchor_W))
                                        : anchor_W;
  }
  [[nodiscard]] static double mu_of_rest(double mu_static, double mu_dynamic) noexcept {
    return broken(Broken::kBreaksLooseEarly) ? mu_dynamic : mu_static;
  }
  using Side = PacedSide;
  [[nodiscard]] static double bump_height_m(double height_m) noexcept {
    return broken(Broken::kBumpsTooLow) ? 0.8 * height_m : height_m;
  }
  [[nodiscard]] static bool bump_is_normal(bool asked) noexcept {
    return asked || broken(Broken::kBumpsTurnTheNormal);
  }
  [[nodiscard]] static BumpForce bump_force(double bump_m, double deep_m, double reach_m) noexcept {
    if (!broken(Broken::kReachFollowsSpeed)) {
      return TouchLaw::bump_force(bump_m, deep_m, reach_m);
    }
    const double pull_m = std::max(bump_m, 0.0);
    return {pull_m, pull_m, std::min(pull_m, reach_m)};
  }
};

}  // namespace tasks
