// Surface properties beyond the plain spring, each only where the scene asks: friction, bump
// texture, material palette, viscosity. A task without any of them holds no Effects object and
// pays one test a tick.
//
//   friction   p_c = frictionless proxy, d = |p_c - h|, n = (p_c - h) / d: the resultant, whatever
//              the number of contacts. t = (I - n n^T)(a - p_c), a = anchor. Stick while
//              |t| <= mu_s d; slip puts the proxy at p_c + mu_d d t/|t|, swept and lifted onto the
//              free place nearest to there, and the anchor with it. Stick again when the motion
//              reverses or stops.
//   texture    height a(p_c) over the foot p_c, a(x) = sum of A_i sum over the axes of sin(2 pi x /
//              P_i), solid in the map; one pattern, or several where materials meet. d and n as
//              above, D = d + a. The energy is
//                V = K (d^2 / 2 + G(D) - G(d)),  G the integral of f,  f(x) = x up to the reach r, then smoothly constant:
//                f(x) = x - (x - r)^2 / r from r to 3 r / 2,  5 r / 4 beyond;  0 below 0,
//              to first order in a K d^2 / 2 + K f(d) a, and K D^2 / 2 wherever D and d are within the reach. The force
//              is its slope, F = -dV/dh = K (d + f(D) - f(d)) n - K f(D) J' grad a, J = dp_c/dh:
//              the tangent plane of one contact (less where it is hollow), the common edge of two,
//              nothing of three. So every loop of the hand is free, at any depth and pace. Along
//              the surface a bump is a spring of its own, of at most K f C, C = sum of A_i (2 pi /
//              P_i)^2; what device and slew guard bear there, k, is the most it gets: r = 4 k / (5
//              K C). Within the reach the height felt is a; deeper the part along the surface stays
//              and the height fades. Before the smooth surface is reached, d < 0 from the field at
//              the hand: the bumps are met one by one, without a step.
//   bump_normal  instead of the height: the force K d along the perturbed normal n - grad a, as
//                published; to compare,
//              not conservative at any depth
//   materials  parameters of the patch's palette, weighted trilinearly at the proxy; all together
//              are followed with at most 100 N/s of force. A texture's period is no number to go
//              through: the pattern of each period has its own weight, and fades in and out where
//              it is.
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
  perception::Vec3 lift_W =
      perception::Vec3::Zero();  // from the proxy to the height felt over its foot
  perception::Vec3 elastic_W = perception::Vec3::Zero();  // F / K
  double stretch_m = 0;                                   // K stretch^2 / 2 is V
};
// `reach_m`: r.
[[nodiscard]] Bumped with_texture(const Field&, const perception::Vec3& p_WH,
                                  const ProxyState& state, const Surface& surface, double reach_m,
                                  double tip_radius_m) noexcept;
// The largest f over r.
inline constexpr double kPlateau = 1.25;
// F / K along the perturbed normal; a contact only.
[[nodiscard]] perception::Vec3 with_bump_normal(const perception::Vec3& p_WH,
                                                const ProxyState& state,
                                                const Surface& surface) noexcept;

// Palette parameters at p_W by trilinear weights of the observed nodes of the newest patch; false
// and untouched when none of the eight is observed.
bool material_at(const perception::SurfacePatch&, const perception::Vec3& p_W,
                 Surface& out) noexcept;

// Moves `now` towards `goal`, all parameters by the same share of their way, so that the force
// changes by at most `force_step_N` at a spring of `stiffness` stretched by `stretch_m`; `reach_m`
// as above.
void follow(Surface& now, const Surface& goal, double stiffness, double stretch_m, double reach_m,
            double force_step_N) noexcept;

}  // namespace tasks
