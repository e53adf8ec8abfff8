// The proxy: where the stylus tip would be if the surface were rigid. Pure functions of field, hand
// and state; one function type for all methods, compared on the same trace.
//
//   nearest      nearest surface point by descent on the field from the hand, 1 step: no memory
//   nearest10    the same, 10 steps
//   force_shading the published method: nearest point of a ray cast (force_shading.hpp)
//   constrained  the proxy moves only through free space, in steps of at most a quarter voxel:
//                up to three tangent constraints, a small quadratic programme, then corrected onto
//                the surface. Every accepted step comes nearer to the hand, so it ends in the
//                minimum of |p - h| that can be reached from the last proxy without passing
//                through the solid (the path-constrained minimum), not in the global one.
//
// Rules of the constrained proxy
//   - contact begins only by crossing from seen-free space to field <= radius; a hand that comes
//     from unknown space gets no force until it has entered seen-free space;
//   - unknown space holds no surface: in contact it is bridged by the last contact planes, so it
//     neither attracts nor drops the hand; the same within two voxels of the window's edge;
//   - at a changed field the proxy is carried along its own side.
// Sources: Ruspini, Kolarov, Khatib 1997 (virtual proxy, up to three planes); Salisbury and Tarr
// 1997 (implicit surfaces).  Frames: W (= map).  SI.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/field.hpp"

namespace tasks {

enum class ProxyMethod : std::uint8_t { kNearest, kNearest10, kForceShading, kConstrained };

struct SurfacePoints;  // tasks/contract/surface_points.hpp

struct ProxyConfig {
  double tip_radius_m = 0.0;
  int iterations_max = 120;   // descent steps a tick; the proxy catches up in the next tick
  double tolerance_m = 2e-8;  // t of the constraint: the proxy sticks sqrt(2 depth t)
  double step_min_m = 2e-6;   // a descent step below this ends the tick
  bool shade = true;          // cell_flow.hpp
  const SurfacePoints* surface = nullptr;  // force_shading only: the newest ray cast
  double paper_friction = 0;               // force_shading only: mu of its circle
};

// n . x >= d, |n| = 1.
struct ProxyPlane {
  double nx = 0, ny = 0, nz = 0, d = 0;
};

// Everything that is remembered from tick to tick, in map coordinates. Trivially copyable: recorded
// and replayed as bytes.
struct ProxyState {
  enum class Phase : std::uint8_t {
    kStart,    // nothing known yet: the next step places the proxy, also from inside
    kUnknown,  // no force until seen-free space is entered
    kFree,     // proxy = hand
    kContact,
  };
  double px = 0, py = 0, pz = 0;      // proxy centre, W
  double sx = 0, sy = 0, sz = 0;      // from the proxy to what is rendered (cell_flow.hpp, shade)
  double nx = 0, ny = 0, nz = 0;      // side: outward normal of the contact; zero when free
  std::array<ProxyPlane, 3> frame{};  // last contact planes, tightest first
  std::int32_t frame_size = 0;
  std::int32_t contacts = 0;  // active constraints of this tick
  Phase phase = Phase::kStart;
  bool held = false;            // this tick used the held frame (window edge, unknown space)
  bool started_inside = false;  // contact was placed, not entered: force has to fade in
  bool anchored = false;        // friction: the anchor below holds
  bool slipping = false;
  bool outside = false;           // force_shading: the field at the hand was > 0 in this tick
  std::int32_t still = 0;         // friction: ticks of slip without motion
  double ax = 0, ay = 0, az = 0;  // friction: anchor, W
  double rubbed = 0;              // friction: how far the proxy was from the frictionless one, m
  double slope = 1;               // of the field where the proxy last was in what is known

  [[nodiscard]] perception::Vec3 p_WP() const noexcept { return {px, py, pz}; }
  [[nodiscard]] perception::Vec3 rendered_WP() const noexcept {
    return {px + sx, py + sy, pz + sz};
  }
  void set_shift(const perception::Vec3& s) noexcept { sx = s.x(), sy = s.y(), sz = s.z(); }
  [[nodiscard]] perception::Vec3 anchor_W() const noexcept { return {ax, ay, az}; }
  void set_anchor(const perception::Vec3& p) noexcept { ax = p.x(), ay = p.y(), az = p.z(); }
  [[nodiscard]] perception::Vec3 normal_W() const noexcept { return {nx, ny, nz}; }
  void set_p(const perception::Vec3& p) noexcept { px = p.x(), py = p.y(), pz = p.z(); }
  void set_normal(const perception::Vec3& n) noexcept { nx = n.x(), ny = n.y(), nz = n.z(); }
};
static_assert(std::is_trivially_copyable_v<ProxyState>);

// One tick: moves `state` to its place for the hand at p_WH. The spring is p_WP - p_WH.
using ProxyStep = void (*)(const Field&, const perception::Vec3& p_WH, ProxyState& state,
                           const ProxyConfig&) noexcept;

void step_nearest(const Field&, const perception::Vec3& p_WH, ProxyState&,
                  const ProxyConfig&) noexcept;
void step_nearest10(const Field&, const perception::Vec3& p_WH, ProxyState&,
                    const ProxyConfig&) noexcept;
void step_constrained(const Field&, const perception::Vec3& p_WH, ProxyState&,
                      const ProxyConfig&) noexcept;

// How far the surface has gone back from under a proxy that rested at p_W, m: 0 where it has not,
// the truncation where nothing is known there any more.
[[nodiscard]] double gone_back(const Field&, const perception::Vec3& p_W,
                               double tip_radius_m) noexcept;

[[nodiscard]] ProxyStep proxy_step(ProxyMethod method) noexcept;
// The names in kProxyMethods; false for any other.
inline constexpr std::string_view kProxyMethods = "constrained, nearest, nearest10, force_shading";
[[nodiscard]] bool parse_proxy_method(std::string_view name, ProxyMethod& out) noexcept;

}  // namespace tasks
