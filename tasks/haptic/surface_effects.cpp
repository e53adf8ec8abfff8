#include "tasks/haptic/surface_effects.hpp"

#include <limits>

#include "rt/effect_count.hpp"

namespace tasks {

using perception::Vec3;

SurfaceEffects::SurfaceEffects(const HapticConfig& c, double stable_N_per_m, double period_s)
    : any_(c.effects()),
      materials_(c.materials),
      bump_normal_(c.bump_normal),
      spring_N_per_m_(c.stiffness_N_per_m),
      scale_(c.scale),
      viscosity_N_s_per_m_(c.viscosity_N_s_per_m),
      period_s_(period_s),
      side_(c, stable_N_per_m),
      stiffness_N_per_m_(c.stiffness_N_per_m) {
  using rt::Effect;
  if (c.friction_static > 0) rt::effect_built(Effect::kFriction);
  if (c.texture_amplitude_m > 0) rt::effect_built(Effect::kTexture);
  if (c.viscosity_N_s_per_m > 0) rt::effect_built(Effect::kViscosity);
  if (c.materials) rt::effect_built(Effect::kMaterials);
  surface_.friction_static = c.friction_static;
  surface_.friction_dynamic = c.friction_dynamic;
  surface_.add(c.texture_amplitude_m, c.texture_period_m);
}

// Parameters of the palette under the proxy.
void SurfaceEffects::follow_material(const Vec3& p_WH, const ProxyState& proxy,
                                     const Touch& touch) noexcept {
  if (proxy.phase != ProxyState::Phase::kContact || touch.newest == nullptr) return;
  Surface goal;
  if (!material_at(*touch.newest, proxy.p_WP(), goal)) return;
  if (touch.touched) {
    follow(surface_, goal, spring_N_per_m_ / scale_, (proxy.p_WP() - p_WH).norm(),
           texture_reach_m(), 100 * period_s_);
  } else {
    surface_ = goal;  // first touch: nothing to go on from
  }
  stiffness_N_per_m_ = spring_N_per_m_ * surface_.stiffness_scale;
}

double SurfaceEffects::reach_m(double side_N_per_m) const noexcept {
  const double stiffest = kPlateau * stiffness_N_per_m_ * surface_.curvature_per_m();
  return stiffest > 0 ? side_N_per_m / stiffest : std::numeric_limits<double>::infinity();
}

Spring SurfaceEffects::spring(const Vec3& p_WH, Contact& contact, const Touch& touch) noexcept {
  ProxyState& proxy = contact.proxy();
  const double tip_radius_m = contact.tip_radius_m();
  Spring s;
  s.contact = contact.touches();
  const double mu_before = surface_.friction_static;
  if (materials_) {
    rt::effect_ran(rt::Effect::kMaterials);
    follow_material(p_WH, proxy, touch);
  } else {
    if (surface_.friction_static > 0) rt::effect_ran(rt::Effect::kFriction);
    if (surface_.patterns > 0) rt::effect_ran(rt::Effect::kTexture);
  }
  const Vec3 smooth = proxy.rendered_WP();
  s.rendered_W = with_friction(
      touch.field, p_WH, proxy,
      {surface_.friction_static, surface_.friction_dynamic, mu_before, materials_}, tip_radius_m);
  Vec3 friction = s.rendered_W - smooth;
  s.elastic_W = smooth - p_WH;
  s.length_m = s.elastic_W.norm();
  if (surface_.patterns > 0 && TouchRules::bump_is_normal(bump_normal_)) {
    if (s.contact) s.elastic_W = with_bump_normal(p_WH, proxy, surface_);
  } else if (surface_.patterns > 0) {
    const double side_N_per_m =
        side_.N_per_m({touch.hand.v_D(), touch.touched, surface_, period_s_});
    const Bumped b =
        with_texture(touch.field, p_WH, proxy, surface_, reach_m(side_N_per_m), tip_radius_m);
    s.contact = b.contact;
    s.elastic_W = b.elastic_W;
    s.length_m = b.stretch_m;
    if (b.contact) {
      s.rendered_W += b.lift_W;
    } else {
      s.rendered_W = p_WH;
      friction = Vec3::Zero();
    }
  }
  s.pull_W = s.elastic_W + friction;
  s.friction_m = friction.norm();
  return s;
}

Vec3 SurfaceEffects::drag_D(double gain, const Vec3& v_D) const noexcept {
  if (viscosity_N_s_per_m_ > 0) rt::effect_ran(rt::Effect::kViscosity);
  return (-gain * viscosity_N_s_per_m_) * v_D;
}

}  // namespace tasks
