// The floor that most tests of the haptic task press.
#pragma once

#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace rig {

inline Scene floor_scene() {
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  return s;
}

// Presses 8 mm into the floor and settles.
inline void press(Rig& r, double depth = 0.008) {
  r.run(Path({{0, 0, 0.01}, {0, 0, -depth}}, 0.1), 0, 0.01 * 10 + 10 * depth + 0.05);
}

}  // namespace rig
