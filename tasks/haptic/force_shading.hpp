// The published method (force shading on a ray-cast surface), as it was published: the proxy is the
// point of one ray cast of the map that is nearest to a goal, found by a reduction over all points.
//
//   S              points and normals of a full ray cast from the last fused camera pose
//   first contact  phi(h) goes from > 0 in the tick before to <= 0: p = argmin over S of |s - h|
//   later          g = h - ((h - p').n') n', with p', n' of the tick before; p = argmin |s - g|,
//                  the lowest index on ties; n = normal at p; ends when (h - p).n >= 0, and F = 0
//                  until the hand has been outside again
//   friction       circle on the tangent plane about the foot of h, radius mu dist(h, plane): p'
//                  inside stays; outside the goal is the point of the circle nearest to p'
//   force          K (p - h)
//
// No window, no smoothing, no quadratic programme.  Frames: W.  SI.
#pragma once

#include <cstddef>

#include "perception/geometry/pose.hpp"
#include "tasks/contract/surface_points.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

// Index of the point nearest to g in float arithmetic, the lowest one on ties; the same index from
// every instruction set. count 0: returns 0.
[[nodiscard]] std::size_t nearest_index(const SurfacePoints& s, const perception::Vec3& g) noexcept;
// The same, one point at a time: its oracle.
[[nodiscard]] std::size_t nearest_index_scalar(const SurfacePoints& s,
                                               const perception::Vec3& g) noexcept;

// cfg.surface null or empty: no contact.
void step_force_shading(const Field&, const perception::Vec3& p_WH, ProxyState&,
                        const ProxyConfig&) noexcept;

}  // namespace tasks
