// teletact accuracy haptic: force error and jump of the proxy methods against CPU time, over
// method, iterations, voxel size and rate; and the picture of the published paper, the concave
// corner, for each method.
//
// Scenes are solids with a closed form of the right force, turned by 17 degrees about a skew axis
// and sampled:
//   corner   two planes, the hand slides in, along and up, 8 mm deep
//   edge     a convex edge, the hand slides off it
//   ball     a ball of 60 mm radius, the hand slides over it
// What is judged is the method: the force before the slew guard; the force behind it stands beside.
// And the product of methods, steps, voxel sizes and rates.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "tools/measure/accuracy/study.hpp"

namespace teletact {

[[nodiscard]] Study study_haptic(std::ostream& progress);

// The concave corner for one method: section through the solid, hand, proxy, and the force every 5
// mm. SVG.
[[nodiscard]] std::string corner_picture(const std::string& method);

}  // namespace teletact
