// Shape with the smallest signed distance; -1 in an empty world.
#pragma once

#include <limits>

#include "drivers/world/world.hpp"

[[nodiscard]] inline int nearest_shape(const drivers::World& w, const perception::Vec3& p_W,
                                       rt::Time t = drivers::World::kBeginning) {
  int best = -1;
  double distance = std::numeric_limits<double>::infinity();
  for (int i = 0; i < static_cast<int>(w.shapes().size()); ++i) {
    const double d = w.signed_distance(p_W, i, t);
    if (d < distance) distance = d, best = i;
  }
  return best;
}
