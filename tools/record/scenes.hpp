// Synthetic sequences with exact truth, as a Kinect v2 sees them (512 x 424, f 365; axial and
// lateral noise, edge drop-out, flying pixels; 0.4 to 5 m unless said otherwise):
//
//   room     5 x 4 m, furnished, carried by hand: 0.25 m/s and 15 deg/s at most
//   stairs   eight steps of 0.17 x 0.28 m between two walls; the camera climbs beside them
//   turn     the same room from its middle, turned about the vertical at 54 deg/s
//   sixth    the room, every sixth frame of the same motion
//   near     over the room's table, readings from 0.35 m on
#pragma once

#include <string>
#include <vector>

#include "tools/record/fusion_sequence.hpp"

namespace teletact {

[[nodiscard]] const std::vector<std::string>& scene_names();
// Throws std::runtime_error naming the scenes that there are.
[[nodiscard]] SyntheticRoom scene_named(const std::string& name);

}  // namespace teletact
