// Surface properties beyond the plain spring, each only where the scene asks: friction, bump
// texture, material palette, viscosity. A task without any of them holds no Effects object and
// pays one test a tick.
//
//   friction   p_c = frictionless proxy, d = |p_c - h|, n = (p_c - h) / d: the resultant, whatever
//              the number of contacts. t = (I - n n^T)(a - p_c), a = anchor. Stick while
//              |t| <= mu_s d; slip puts the proxy at p_c + mu_d d t/|t|, swept and lifted onto the
//              surface, and the anchor with it. Stick again when the motion reverses or stops.
//   texture    height a(p_c) over the foot p_c, a(x) = A sum over the axes of sin(2 pi x_i / P), solid in
//              the map. With D = d + a, d and n as above, the energy is V = K D^2 / 2 and the force its
//              slope: F = -dV/dh = K D (n - J' grad a), J = dp_c/dh: the tangent plane of one contact (less
//              where it is hollow), the common edge of two, nothing of three. The part along the surface stops growing with D at the
//              bumps' radius of curvature r = P^2 / (4 pi^2 A): there a bump is as stiff sideways as the wall
//              (K D / r in general: no device would stay quiet on it). So the height is a(p_c) however deep
//              the hand is; a loop along the surface costs nothing, and up to D = r no loop does. Before the smooth surface is reached,
//              d < 0 from the field at the hand: the bumps are met one by one, without a step.
//   materials  parameters of the patch's palette, weighted trilinearly at the proxy and followed
//              with at most 100 N/s of force.
//   viscosity  - b v, v from position with 10 ms of delay.
// Sources: Salisbury and Tarr 1997 (cone on implicit surfaces).  Frames: W.  SI.
#pragma once

#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

// Friction of one tick: where the proxy is with it. Keeps anchor and slip in `state`.
[[nodiscard]] perception::Vec3 with_friction(const Field&, const perception::Vec3& p_WH,
                                             ProxyState& state, double mu_static, double mu_dynamic,
                                             double tip_radius_m) noexcept;

// Texture of one tick. What the hand feels of a contact on it.
struct Bumped {
  bool contact = false;
  perception::Vec3 lift_W = perception::Vec3::Zero();  // from the proxy to the bump over its foot
  perception::Vec3 elastic_W = perception::Vec3::Zero();  // F / K
  double stretch_m = 0;                                   // D
};
[[nodiscard]] Bumped with_texture(const Field&, const perception::Vec3& p_WH,
                                  const ProxyState& state, double amplitude_m, double period_m,
                                  double tip_radius_m) noexcept;

// Palette parameters at p_W by trilinear weights of the observed nodes of the newest patch; false
// and untouched when none of the eight is observed.
bool material_at(const perception::SurfacePatch&, const perception::Vec3& p_W,
                 perception::Material& out) noexcept;

// Moves `now` towards `goal` so that no parameter changes the force by more than `force_step_N` at
// a spring of `stiffness` stretched by `stretch_m`.
void follow(perception::Material& now, const perception::Material& goal, double stiffness,
            double stretch_m, double force_step_N) noexcept;

}  // namespace tasks
