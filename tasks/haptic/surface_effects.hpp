// What the scene asks of the spring beyond the plain one (effects.hpp): friction, texture and
// viscosity, and the materials they come from.
// Frames: W world, D haptic base.  SI.  Nothing here allocates, locks or throws.
#pragma once

#include "perception/geometry/pose.hpp"
#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/contact.hpp"
#include "tasks/haptic/effects.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/hand.hpp"
#include "tasks/haptic/haptic_config.hpp"
#include "tasks/haptic/spring.hpp"
#include "tasks/haptic/touch_rules.hpp"

namespace tasks {

class SurfaceEffects {
 public:
  // What is touched in a tick.
  struct Touch {
    const Field& field;
    const perception::SurfacePatch* newest;  // whose palette counts
    const Hand& hand;
    bool touched;  // in the last tick too
  };

  SurfaceEffects() = default;
  // `stable_N_per_m`: what the device renders stably.
  SurfaceEffects(const HapticConfig&, double stable_N_per_m, double period_s);

  // The scene asks for an effect.
  [[nodiscard]] bool any() const noexcept { return any_; }
  // K, which follows the material.
  [[nodiscard]] double stiffness_N_per_m() const noexcept { return stiffness_N_per_m_; }
  // Down to which depth a bump is felt as high as it is, scene metres; infinite without bumps.
  [[nodiscard]] double texture_reach_m() const noexcept { return reach_m(side_.N_per_m()); }

  // The spring from the hand at p_WH to the proxy as the effects have it. Keeps what friction
  // remembers in the proxy.
  [[nodiscard]] Spring spring(const perception::Vec3& p_WH, Contact& contact,
                              const Touch& touch) noexcept;
  // How strong the friction in a spring is, N at the device.
  [[nodiscard]] double friction_N(const Spring& spring) const noexcept {
    return stiffness_N_per_m_ * spring.friction_m / scale_;
  }
  // The drag of viscosity on a hand.
  [[nodiscard]] perception::Vec3 drag_D(double gain, const perception::Vec3& v_D) const noexcept;

 private:
  [[nodiscard]] double reach_m(double side_N_per_m) const noexcept;
  void follow_material(const perception::Vec3& p_WH, const ProxyState& proxy,
                       const Touch& touch) noexcept;

  bool any_ = false, materials_ = false, bump_normal_ = false;
  double spring_N_per_m_ = 0;  // without a material
  double scale_ = 1, viscosity_N_s_per_m_ = 0, period_s_ = 0;
  Surface surface_;  // the parameters of this tick
  TouchRules::Side side_;
  double stiffness_N_per_m_ = 0;
};

}  // namespace tasks
