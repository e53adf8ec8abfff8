// Reads a fused map at any point and finds paths through space that it has seen free. An
// independent observer: it shares no code with the renderer.
// Frames: W world (= map).  SI.
#pragma once

#include <vector>

#include "perception/tsdf/blocks/map_reader.hpp"
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
  // Height over p along n of the first crossing from free to solid on the way from `above` to
  // -`below`; NaN: none.
  [[nodiscard]] double height(const perception::Vec3& p_W, const perception::Vec3& n_W,
                              double above, double below);

 private:
  const perception::TsdfMap& map_;
  perception::MapReader reader_;
};

// A* over cells of 40 mm, then corners cut while the straight is clear.
class Ways {
 public:
  explicit Ways(MapProbe& probe) : probe_(probe) {}
  // From, corners, to; empty: there is none.
  [[nodiscard]] std::vector<perception::Vec3> find(const perception::Vec3& from_W,
                                                   const perception::Vec3& to_W);

 private:
  [[nodiscard]] std::vector<perception::Vec3> cut(const std::vector<perception::Vec3>& way);
  MapProbe& probe_;
};

}  // namespace teletact
