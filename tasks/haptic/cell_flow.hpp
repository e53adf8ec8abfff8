// The descent of the constrained proxy over the zero set of a trilinear field, cell by cell.
//
// Within a cell the zero set is one smooth sheet; where cells meet it is bent. So the descent is a
// chain of smooth problems: within one closed cell, from the proxy, towards
//
//   min |q - h|^2   subject to   phi_c(q) >= R,   at <= q <= at + 1
//
// by Newton steps on the sheet (its curvature included) that end at the walls of the cell. On a
// face, an edge or a node of the grid every cell that meets there is asked what is left of the pull
// in it: the projection of h - q onto the cone of ways that neither enter the solid nor leave the
// cell. The one with the most left is gone into; when none has any left, q is at rest: exactly the
// first-order condition of the minimum over the union of the cells. No step ends farther from h.
//
// Lengths in voxels, frame W over voxel. For descent.cpp and effects.cpp: the way down is
// cell_flow.cpp, what is asked where it ended cell_rest.cpp. Nothing here allocates, locks or
// throws.
#pragma once

#include <array>
#include <cstdint>

#include "tasks/haptic/field.hpp"
#include "tasks/haptic/nearest_on_planes.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

struct Tangent {
  HalfSpace half;  // metres, W
  bool known = false;
};

class CellFlow {
 public:
  using Vec3 = perception::Vec3;

  // `held`: half-spaces, metres, that stand for the surface where the field is unknown.
  CellFlow(const Field& field, const ProxyConfig& cfg, double radius_m, const Vec3& p_WH,
           const std::array<HalfSpace, 3>& held, std::size_t held_size) noexcept;

  // From p_W, which is outside the solid (or in it by rounding), to where no way leads nearer.
  [[nodiscard]] Vec3 run(const Vec3& p_W) noexcept;
  // Beside the place reached: on a convex bend between two cells the hand may have a place of rest
  // on either side. A bend of up to some 10 degrees between flat sheets is the samples' work, not
  // the surface's: the proxy stays at its own, and what is rendered goes over from one to the other
  // with the barrier that is left between them, so that it neither jumps nor sticks there.
  [[nodiscard]] Vec3 shade() noexcept;
  // For the next run; what the tick may take is not given again.
  void set_radius(double radius_m) noexcept;
  [[nodiscard]] Vec3 place() const noexcept { return field_.voxel() * q_; }
  // The tangents at the place reached that bear the pull, the one that bears most first; the count.
  [[nodiscard]] std::size_t tangents(std::array<Tangent, 3>& out) const noexcept;

 private:
  static constexpr int kSamples = 350;
  static constexpr double kFlat2 = 1e-16;  // such a gradient gives no direction
  using Index = std::array<std::int32_t, 3>;
  // One of the cells that meet at a point.
  struct Side {
    Index at{};                 // its lowest node
    std::array<int, 3> sign{};  // +1, -1: it lies above, below the wall the point is on; 0: no wall
  };
  struct Local {
    double f = 0;              // (phi - R) / voxel
    Vec3 g = Vec3::Zero();     // gradient of f
    Vec3 bend = Vec3::Zero();  // f_yz, f_xz, f_xy
    bool known = false;
  };
  // What is left of the pull in a cell.
  struct Pull {
    Vec3 d = Vec3::Zero();
    double lambda = 0;    // of the surface
    unsigned fixed = 0;   // axes that a wall bars
    bool barred = false;  // by the surface
  };

  static Vec3 without(Vec3 v, unsigned axes) noexcept {
    for (int a = 0; a < 3; ++a) {
      if ((axes & (1U << a)) != 0) v[a] = 0;
    }
    return v;
  }
  [[nodiscard]] Local local(const Index& at, const Vec3& q) const noexcept;
  [[nodiscard]] std::size_t around(const Vec3& q, std::array<Side, 8>& out) const noexcept;
  [[nodiscard]] static Pull pull(const Local& l, const Side& side, const Vec3& r) noexcept;
  [[nodiscard]] static Vec3 newton(const Local& l, const Pull& p, const Vec3& r) noexcept;
  [[nodiscard]] bool move() noexcept;
  void descend() noexcept;
  [[nodiscard]] bool onto_wall() noexcept;
  [[nodiscard]] bool resting(const Vec3& q) const noexcept;
  [[nodiscard]] bool advance(const Side& side, const Local& l, const Pull& p,
                             const Vec3& r) noexcept;
  [[nodiscard]] bool search(const Side& side, const Local& l, const Pull& p, Vec3 s) noexcept;
  [[nodiscard]] bool settle(const Index& at, Vec3& x, unsigned fixed) const noexcept;
  [[nodiscard]] bool meet(const Index& at, Vec3& x) const noexcept;
  void raise() noexcept;
  void rest_in(const Index& at) noexcept;
  void pass_on(const Index& at, unsigned wall) noexcept;
  struct Beyond {
    Vec3 q = Vec3::Zero();  // where the proxy would rest
    double share = 0;       // of it in what is rendered
    bool nearer = false;    // and hardly a ridge before it
  };
  [[nodiscard]] bool beyond(const Index& at, int axis, bool up, Beyond& out) noexcept;
  [[nodiscard]] double smoothed(double from_here, double from_there, double here,
                                const Vec3& other) const noexcept;

  const Field& field_;
  const ProxyConfig& cfg_;
  Vec3 h_, q_ = Vec3::Zero();
  double radius_, step_min_;
  std::array<HalfSpace, 3> held_;  // voxels
  std::size_t held_size_;
  mutable int left_ = kSamples;  // of this tick; what is not reached is left to the next one
};

}  // namespace tasks
