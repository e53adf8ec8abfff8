// What is left in the map of a solid that was taken away, cm^3: cells of 10 mm, inside the solid's
// bounding box grown by 50 mm (`X_WB` its centre and axes, `half` its half edges), that hold a
// vertex more than 30 mm off every surface of the world as it is now.
#pragma once

#include <array>
#include <cmath>
#include <set>

#include "drivers/world/world.hpp"
#include "perception/tsdf/mesh/mesh.hpp"

[[nodiscard]] inline double ghost_volume_cm3(const perception::Mesh& mesh,
                                             const drivers::World& now,
                                             const perception::Pose& X_WB,
                                             const perception::Vec3& half) {
  constexpr double kGrown_m = 0.05, kGhost_m = 0.03, kCell_m = 0.01;
  std::set<std::array<long, 3>> cells;
  for (const auto& v : mesh.vertices_W) {
    const perception::Vec3 p = v.cast<double>();
    const perception::Vec3 b = X_WB.inverse(Eigen::Isometry) * p;
    if (((b.cwiseAbs() - half).array() > kGrown_m).any()) continue;
    if (std::abs(now.signed_distance(p)) <= kGhost_m) continue;
    std::array<long, 3> cell{};
    for (int i = 0; i < 3; ++i)
      cell[static_cast<std::size_t>(i)] = static_cast<long>(std::floor(p[i] / kCell_m));
    cells.insert(cell);
  }
  return static_cast<double>(cells.size());
}
