// Places of a fused map that a hand may touch.
//
// A place is found from the field alone, by probing round a point of a ray cast of the map, on a
// plane fitted there.
//   wall    upright, nine tenths of the surface within 10 mm of the plane for 100 mm around
//   top     level, nine tenths within 4 mm for 50 mm around
//   edge    in one direction the surface ends within 70 mm, and behind that it is free 50 mm down;
//           its side was seen, and does not recede
//   corner  so in two directions at 60 to 120 degrees and between them
// and over each of them nothing else for 50 mm.
// Frames: W world (= map).  SI.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "tools/measure/haptic/map_probe.hpp"

namespace teletact {

struct Place {
  enum class Kind : std::uint8_t { kWall, kTop, kEdge, kCorner };
  Kind kind = Kind::kTop;
  perception::Vec3 p_W = perception::Vec3::Zero(), n_W = perception::Vec3::UnitZ();
  std::array<perception::Vec3, 2> out_W{perception::Vec3::UnitX(),
                                        perception::Vec3::UnitY()};  // over the edges
  std::array<double, 2> edge_m{0, 0};                                // how far off p they are
  [[nodiscard]] bool flat() const { return kind == Kind::kWall || kind == Kind::kTop; }
};
[[nodiscard]] const char* name_of(Place::Kind kind);

constexpr double kLift_m = 0.05;  // over a place, before and after it is touched
[[nodiscard]] inline perception::Vec3 over(const Place& place) {
  return place.p_W + kLift_m * place.n_W;
}

// Two directions of a plane with normal n.
struct Axes {
  perception::Vec3 a, b;
  explicit Axes(const perception::Vec3& n) : a(n.unitOrthogonal()), b(n.cross(a)) {}
  [[nodiscard]] perception::Vec3 at(double angle) const {
    return std::cos(angle) * a + std::sin(angle) * b;
  }
};

// A place about p, a point of the surface with outward normal n, if there is one.
[[nodiscard]] std::optional<Place> place_at(MapProbe& probe, const perception::Vec3& p_W,
                                            const perception::Vec3& n_W,
                                            const perception::Vec3& up_W);

}  // namespace teletact
