// What the effects make of the spring between hand and proxy.
#include <algorithm>
#include <limits>

#include "rt/effect_count.hpp"
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

double HapticTask::reach_m(double side_N_per_m) const noexcept {
  const double stiffest = kPlateau * stiffness_ * surface_.curvature_per_m();
  return stiffest > 0 ? side_N_per_m / stiffest : std::numeric_limits<double>::infinity();
}

double HapticTask::texture_reach_m() const noexcept { return reach_m(side_.N_per_m()); }

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
  if (surface_.patterns > 0 && TouchRules::bump_is_normal(config_.bump_normal)) {
    if (s.contact) s.elastic_W = with_bump_normal(p_WH, proxy_, surface_);
  } else if (surface_.patterns > 0) {
    const double side_N_per_m = side_.N_per_m({v_D_, was_contact_, surface_, period_s_});
    const Bumped b = with_texture(field_, p_WH, proxy_, surface_, reach_m(side_N_per_m),
                                  proxy_config_.tip_radius_m);
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
