// Where a person may ask for something, and what the base meets there. Pure. Frames: W world, M map
// of the floor.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "perception/geometry/planar.hpp"
#include "perception/ground/cost_map.hpp"
#include "tools/desk/intents/intent.hpp"
#include "tools/host/console.hpp"

namespace teletact {

// Why nothing can be asked for at these places; empty: it can, or there is no map of the floor yet.
[[nodiscard]] std::string beyond_map(const perception::CostMap& map,
                                     std::span<const perception::Vec3> places_W);
// The same of a place on the floor, whose height is not said.
[[nodiscard]] std::string beyond_floor(const perception::CostMap& map, double x_W, double y_W);
[[nodiscard]] std::string beyond_map(const perception::CostMap& map, const DrawnObstacle& o);

// The base in W, as far as it is known.
[[nodiscard]] std::optional<perception::Pose2> base_in_world(const OperatorView& seen);

// The first of the drawn obstacles that a circle on the floor reaches into; 0: none.
[[nodiscard]] std::uint16_t reaches_into(const std::map<std::uint16_t, DrawnObstacle>& drawn,
                                         double x_W, double y_W, double radius_m);

// While the base is driven by hand: which keep-out it is in or about to enter. Nothing stops it.
class KeepOutWatch {
 public:
  // Where it is in so much at the speed that is asked for is "about to".
  static constexpr double kAhead_s = 0.7;
  // True: another word than before, and not none.
  [[nodiscard]] bool look(const std::map<std::uint16_t, DrawnObstacle>& drawn,
                          const perception::Pose2& base_W, const perception::Twist2& asked,
                          double radius_m);
  void clear() { text_.clear(); }
  [[nodiscard]] const std::string& text() const noexcept { return text_; }  // empty: none

 private:
  std::string text_;
};

}  // namespace teletact
