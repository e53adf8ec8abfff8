// A hand path over a fused map, made by a seeded script: flat places, walls, an edge of something
// level, a corner of a box. The target is 3 to 8 mm under the map's own surface and moves at 20 to
// 200 mm/s; between two places it goes through space that was seen free. Where: map_round.hpp.
// Frames: W world (= map).  SI.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tools/measure/haptic/map_round.hpp"

namespace teletact {

struct MapPath {
  std::vector<Place> places;             // in the order in which they are touched
  std::vector<perception::Vec3> hand_W;  // one a tick
  std::vector<int> place;                // of each tick; -1: on the way
  double way_m = 0;                      // through the free, once around
  double planned_s = 0;                  // at places with the hand under the map's surface
  std::array<int, 4> chosen_from{};      // walls, tops, edges, corners that were found
};

struct MapPathOptions {
  std::uint64_t seed = 1;
  double seconds = 60, period_s = 1e-3;
  double least_s = 3;                // at a place; more when the time is enough for all of them
  double seen_s = 5;                 // by then the map holds all of its surfaces
  double contact = 0.725;            // of the time, planned; a map that still grows loses some
  int pool = 400;                    // places of a kind that are chosen from
  std::optional<Place::Kind> first;  // begins at such a place; none: at what is seen first
};

// `views`, `up_W` and what is thrown: find_places().
[[nodiscard]] MapPath make_map_path(const perception::TsdfMap& map,
                                    const perception::Intrinsics& camera,
                                    const std::vector<perception::Pose>& views,
                                    const perception::Vec3& up_W, const MapPathOptions& options);

}  // namespace teletact
