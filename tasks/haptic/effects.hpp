// Surface properties beyond the plain spring, each only where the scene asks: friction, bump
// texture, material palette, viscosity. A task without any of them holds no Effects object and
// pays one test a tick.
//
//   friction   p_c = frictionless proxy, d = |p_c - h|, n = (p_c - h) / d: the resultant, whatever
//              the number of contacts. t = (I - n n^T)(a - p_c), a = anchor. Stick while
//              |t| <= mu_s d; slip puts the proxy at p_c + mu_d d t/|t|, swept and lifted onto the
//              free place nearest to there, and the anchor with it. Stick again when the motion reverses or stops.
//   texture    height a(p_c) over the foot p_c, a(x) = sum of A_i sum over the axes of sin(2 pi x / P_i), solid in
//              the map; one pattern, or several where materials meet. With D = d + a, d and n as above, the energy
//              is V = K D^2 / 2 and the force its slope: F = -dV/dh = K D (n - J' grad a), J = dp_c/dh: the tangent
//              plane of one contact (less where it is hollow), the common edge of two, nothing of three.
//              Along the surface a bump is a spring of its own, of at most K D C, C = sum of A_i (2 pi / P_i)^2. What
//              device and slew guard bear there is k: from the depth r = k / (K C) on the part along the surface
//              stops growing. Up to r every loop of the hand is free; deeper, loops along the surface are, and the
//              height felt is a(p_c) still. Before the smooth surface is reached, d < 0 from the field at the hand:
//              the bumps are met one by one, without a step.
//   bump_normal  instead of the height: the force K d along the perturbed normal n - grad a, as published; to compare,
//              not conservative at any depth
//   materials  parameters of the patch's palette, weighted trilinearly at the proxy; all together are followed with
//              at most 100 N/s of force. A texture's period is no number to go through: the pattern of each period
//              has its own weight, and fades in and out where it is.
//   viscosity  - b v, v from position with 10 ms of delay.
// Sources: Salisbury and Tarr 1997 (cone on implicit surfaces).  Frames: W.  SI.
#pragma once

#include <array>
#include <cstddef>

#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

struct FrictionCone {
  double mu_static = 0, mu_dynamic = 0;
  double mu_static_before = 0;  // of the tick before
  bool moves = false;           // the cone may change from tick to tick, as the materials do
};
// Friction of one tick: where the proxy is with it. Keeps anchor and slip in `state`.
[[nodiscard]] perception::Vec3 with_friction(const Field&, const perception::Vec3& p_WH,
                                             ProxyState& state, const FrictionCone& cone,
                                             double tip_radius_m) noexcept;

// One pattern of bumps.
struct Bumps {
  double amplitude_m = 0, period_m = 0.002;
};

// The surface as the effects have it: parameters of one material, or of a mixture.
struct Surface {
  static constexpr std::size_t kMostPatterns = 16;
  double stiffness_scale = 1, friction_static = 0, friction_dynamic = 0;
  std::array<Bumps, kMostPatterns> bumps{};  // periods differ
  std::size_t patterns = 0;

  // Adds to the pattern of this period; nothing where the amplitude is 0 or there is no room.
  void add(double amplitude_m, double period_m) noexcept;
  [[nodiscard]] double height_m() const noexcept;         // sum of A: a third of the highest crest
  [[nodiscard]] double steepness() const noexcept;        // of the steepest flank, at most
  [[nodiscard]] double curvature_per_m() const noexcept;  // C
};

// Texture of one tick. What the hand feels of a contact on it.
struct Bumped {
  bool contact = false;
  perception::Vec3 lift_W = perception::Vec3::Zero();  // from the proxy to the bump over its foot
  perception::Vec3 elastic_W = perception::Vec3::Zero();  // F / K
  double stretch_m = 0;                                   // D
};
// `reach_m`: r.
[[nodiscard]] Bumped with_texture(const Field&, const perception::Vec3& p_WH,
                                  const ProxyState& state, const Surface& surface, double reach_m,
                                  double tip_radius_m) noexcept;
// F / K along the perturbed normal; a contact only.
[[nodiscard]] perception::Vec3 with_bump_normal(const perception::Vec3& p_WH,
                                                const ProxyState& state,
                                                const Surface& surface) noexcept;

// Palette parameters at p_W by trilinear weights of the observed nodes of the newest patch; false
// and untouched when none of the eight is observed.
bool material_at(const perception::SurfacePatch&, const perception::Vec3& p_W,
                 Surface& out) noexcept;

// Moves `now` towards `goal`, all parameters by the same share of their way, so that the force changes by at most
// `force_step_N` at a spring of `stiffness` stretched by `stretch_m`; `reach_m` as above.
void follow(Surface& now, const Surface& goal, double stiffness, double stretch_m, double reach_m,
            double force_step_N) noexcept;

}  // namespace tasks
