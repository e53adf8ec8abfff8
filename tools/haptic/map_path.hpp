// A hand path over a fused map, made by a seeded script: flat places, walls, an edge of something level, a corner of
// a box. The target is 3 to 8 mm under the map's own surface and moves at 20 to 200 mm/s; between two places it goes
// through space that was seen free.
//
// A place is found by probing the field alone: about a point of a ray cast of the map, on a plane fitted there.
//   wall    upright, nine tenths of the surface within 10 mm of the plane for 100 mm around
//   top     level, nine tenths within 4 mm for 50 mm around
//   edge    in one direction the surface ends within 70 mm, and behind that it is free 50 mm down
//   corner  so in two directions at 60 to 120 degrees and between them
// Frames: W world (= map).  SI.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "perception/tsdf/map_reader.hpp"
#include "perception/tsdf/tsdf_map.hpp"

namespace teletact {

// The field of a map at any point, as an observer of its own: trilinear, weight >= 2.
class MapProbe {
 public:
  explicit MapProbe(const perception::TsdfMap& map) : map_(map), reader_(map, 2.0) {}
  // m; NaN where a corner is not observed.
  [[nodiscard]] double value(const perception::Vec3& p_W);
  // Observed and farther than `margin` outside, or seen free.
  [[nodiscard]] bool free(const perception::Vec3& p_W, double margin);
  // Height over p along n of the first crossing from free to solid on the way from `above` to -`below`; NaN: none.
  [[nodiscard]] double height(const perception::Vec3& p_W, const perception::Vec3& n_W,
                              double above, double below);

 private:
  const perception::TsdfMap& map_;
  perception::MapReader reader_;
};

struct Place {
  enum class Kind : std::uint8_t { kWall, kTop, kEdge, kCorner };
  Kind kind = Kind::kTop;
  perception::Vec3 p_W = perception::Vec3::Zero(), n_W = perception::Vec3::UnitZ();
  std::array<perception::Vec3, 2> out_W{perception::Vec3::UnitX(),
                                        perception::Vec3::UnitY()};  // over the edges
  std::array<double, 2> edge_m{0, 0};                                // how far off p they are
};
[[nodiscard]] const char* name_of(Place::Kind kind);

struct MapPath {
  std::vector<Place> places;             // in the order in which they are touched
  std::vector<perception::Vec3> hand_W;  // one a tick
  std::vector<int> place;                // of each tick; -1: on the way
};

struct MapPathOptions {
  std::uint64_t seed = 1;
  double seconds = 60, period_s = 1e-3;
  double stroke_s = 10;  // at each place
};

// `views`: cameras X_WC from which the map's surface is looked at. `up_W` unit, roughly: gravity is
// found from the surfaces near it. Throws std::runtime_error when the map
// holds no wall, no edge or no corner.
[[nodiscard]] MapPath make_map_path(const perception::TsdfMap& map,
                                    const perception::Intrinsics& camera,
                                    const std::vector<perception::Pose>& views,
                                    const perception::Vec3& up_W, const MapPathOptions& options);

}  // namespace teletact
