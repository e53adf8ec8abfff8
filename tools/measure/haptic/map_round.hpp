// Chooses the places of a fused map that a hand touches one after another, and the paths between
// them.
// Frames: W world (= map).  SI.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "rt/random.hpp"
#include "tools/measure/haptic/map_places.hpp"

namespace teletact {

// Places in the order in which they are touched, and the ways from over() each to over() the next,
// back to the first from the last: through space that was seen free.
struct Round {
  std::vector<Place> places;
  std::vector<std::vector<perception::Vec3>> ways;
  double way_m = 0;
  std::array<int, 4> chosen_from{};  // places of each kind that were found
};

// A corner, an edge, a wall and two tops, each another surface. `views`: cameras X_WC, in the order
// in time, from which the map's surface is looked at. `up_W` unit, roughly: gravity is found from
// the surfaces near it. Begins at the kind `first`, or at what is seen first. `pool`: how many of a
// kind are chosen from at most. Throws std::runtime_error when the map holds no wall, no edge or no
// corner.
[[nodiscard]] Round find_places(const perception::TsdfMap& map, MapProbe& probe,
                                const perception::Intrinsics& camera,
                                const std::vector<perception::Pose>& views,
                                const perception::Vec3& up_W, std::optional<Place::Kind> first,
                                int pool, rt::Random& random);

}  // namespace teletact
