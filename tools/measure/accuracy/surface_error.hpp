// Distance of a fused surface from the solids that it was fused from.
//
//   error         of a vertex: distance to the nearest surface of the world, |World::signed_distance|. All
//                 vertices count, none is trimmed
//   completeness  share of the true surface that has a vertex within 10 mm. The true surface:
//                 points where a ray of some frame meets it, one a cell of 40 mm of each solid, of
//                 those that at least 5 frames see (no solid in between) at 0.4 to 3.5 m
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "drivers/world/world.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/tsdf/mesh/mesh.hpp"

namespace teletact {

struct SurfaceError {
  std::size_t vertices = 0;
  std::size_t stray = 0;  // vertices more than 10 mm off
  double median_mm = 0, p95_mm = 0, rmse_mm = 0, max_mm = 0;
  double completeness = 0;
};

// Points of the true surface that the frames see, as above.
[[nodiscard]] std::vector<perception::Vec3> seen_surface(const drivers::World& world,
                                                         const perception::Intrinsics& camera,
                                                         std::span<const perception::Pose> X_WC);

// `mesh` in the world's frame.
[[nodiscard]] SurfaceError surface_error(const perception::Mesh& mesh, const drivers::World& world,
                                         std::span<const perception::Vec3> seen_W);

}  // namespace teletact
