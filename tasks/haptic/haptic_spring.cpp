// What the effects make of the spring between hand and proxy.
#include <algorithm>
#include <limits>

#include "rt/effect_count.hpp"
#include "tasks/haptic/broken.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace tasks {

using perception::Vec3;

// Parameters of the palette under the proxy.
void HapticTask::follow_material(const Vec3& p_WH) noexcept {
  if (proxy_.phase != ProxyState::Phase::kContact || newer_ == nullptr) return;
  Surface goal;
  if (!material_at(*newer_, proxy_.p_WP(), goal)) return;
  if (was_contact_) {
    follow(surface_, goal, config_.stiffness_N_per_m / config_.scale, (proxy_.p_WP() - p_WH).norm(),
           texture_reach_m(), 100 * period_s_);
  } else {
    surface_ = goal;  // first touch: nothing to go on from
  }
  stiffness_ = config_.stiffness_N_per_m * surface_.stiffness_scale;
}

#if defined(TELETACT_HAPTIC_BROKEN) && TELETACT_HAPTIC_BROKEN
// As it was: the guard is asked at the hand's own pace, from 10 mm/s on, followed with 30 N/s.
void HapticTask::follow_pace() noexcept {
  const double v = std::max(v_D_.norm(), 0.01), k = config_.stiffness_N_per_m;
  const double rate = std::min(config_.slew_calm_N_per_s + 2 * std::max(k, 1000.0) * v,
                               std::max(config_.slew_N_per_s, 1.1 * k * v));
  const double goal = std::min(device_side_N_per_m_, 0.8 * rate / v);
  const double most = was_contact_ ? 30 * period_s_ * surface_.curvature_per_m() /
                                         std::max(surface_.steepness(), 1e-12)
                                   : std::numeric_limits<double>::infinity();
  side_N_per_m_ += std::clamp(goal - side_N_per_m_, -most, most);
}
#else
void HapticTask::follow_pace() noexcept {}
#endif

double HapticTask::texture_reach_m() const noexcept {
  const double stiffest = kPlateau * stiffness_ * surface_.curvature_per_m();
  return stiffest > 0 ? side_N_per_m_ / stiffest : std::numeric_limits<double>::infinity();
}

// The spring with what the scene asks for beyond the plain one; fills rendered_W_.
HapticTask::Spring HapticTask::spring_of(const Vec3& p_WH) noexcept {
  Spring s;
  s.contact = proxy_.phase == ProxyState::Phase::kContact;
  const double mu_before = surface_.friction_static;
  if (config_.materials) {
    rt::effect_ran(rt::Effect::kMaterials);
    follow_material(p_WH);
  } else {
    if (surface_.friction_static > 0) rt::effect_ran(rt::Effect::kFriction);
    if (surface_.patterns > 0) rt::effect_ran(rt::Effect::kTexture);
  }
  const Vec3 smooth = proxy_.rendered_WP();
  rendered_W_ = with_friction(
      field_, p_WH, proxy_,
      {surface_.friction_static, surface_.friction_dynamic, mu_before, config_.materials},
      proxy_config_.tip_radius_m);
  Vec3 friction = rendered_W_ - smooth;
  s.elastic_W = smooth - p_WH;
  s.length_m = s.elastic_W.norm();
  if (surface_.patterns > 0 && (config_.bump_normal || broken(Broken::kBumpsTurnTheNormal))) {
    if (s.contact) s.elastic_W = with_bump_normal(p_WH, proxy_, surface_);
  } else if (surface_.patterns > 0) {
    if (broken(Broken::kReachFollowsSpeed)) follow_pace();
    const Bumped b =
        with_texture(field_, p_WH, proxy_, surface_, texture_reach_m(), proxy_config_.tip_radius_m);
    s.contact = b.contact;
    s.elastic_W = b.elastic_W;
    s.length_m = b.stretch_m;
    if (b.contact) {
      rendered_W_ += b.lift_W;
    } else {
      rendered_W_ = p_WH;
      friction = Vec3::Zero();
    }
  }
  s.pull_W = s.elastic_W + friction;
  s.friction_m = friction.norm();
  return s;
}

// Drag of the scene's viscosity; tells how much of the spring is friction.
Vec3 HapticTask::viscous(const Spring& spring, HapticTelemetry& t) const noexcept {
  if (config_.viscosity_N_s_per_m > 0) rt::effect_ran(rt::Effect::kViscosity);
  t.friction_N = stiffness_ * spring.friction_m / config_.scale;
  return (-t.gain * config_.viscosity_N_s_per_m) * v_D_;
}

}  // namespace tasks
