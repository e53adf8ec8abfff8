// What one picture after another has shown of places that a hand may touch (view_places.hpp), and which of them is next.
//
//   seen again    the newest picture shows the surface there: the place is where it shows now
//   gone          the newest picture looks through it, or shows nothing there, twice in a row: forgotten
//   hidden        something stands before it in the newest picture: not chosen until that has gone
//   out of view   kept as it was
//
// Chosen is only what two pictures have shown, half of those that looked at it since, and what the hand can reach.
// Frames: W world (= map), D haptic base. SI. Same pictures, same places.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "drivers/haptic/workspace_map.hpp"
#include "perception/ground/cost_map.hpp"
#include "tools/touch/view_places.hpp"

namespace teletact {

// Where the hand gets with the device's workspace as it lies.
struct Reach {
  static constexpr double kUsed = 0.9;  // of the workspace's radius
  drivers::WorkspaceMap map;
  double radius_m = 0.075;                     // at the device
  double standoff_m = 0.05, pressed_m = 0.04;  // over the surface, and into it
  [[nodiscard]] bool holds(const perception::Vec3& p_W) const noexcept {
    return map.to_device(p_W).norm() <= kUsed * radius_m;
  }
  [[nodiscard]] bool holds(const TouchPlace& place) const noexcept {
    return holds(place.p_W + standoff_m * place.n_W) && holds(place.p_W - pressed_m * place.n_W);
  }
};

class PlaceMemory {
 public:
  static constexpr int kPictures = 2;  // that have shown it
  struct Known {
    TouchPlace place;
    int pictures = 1, looks = 1, missed = 0;  // found in; it was in view in; not there in the last
    bool hidden = false;
    [[nodiscard]] bool sure() const noexcept {
      return pictures >= kPictures && 2 * pictures >= looks && !hidden && missed == 0;
    }
  };
  // `reach`: only what it holds; null: all.
  void see(const tasks::SceneView& view, const perception::Vec3& up_W, const Reach* reach);
  [[nodiscard]] const std::vector<Known>& known() const noexcept { return known_; }
  // The nearest sure place within 80 mm of p, with p within 15 mm of its plane; null: there is none.
  [[nodiscard]] const Known* at(const perception::Vec3& p_W) const noexcept;

 private:
  std::vector<Known> known_;
};

// Up, in W. Where the ground was found it is the ground's normal. Else nobody tells: the camera is taken to be held without
// roll at first, looking at most 75 degrees down, and up is of all that this leaves what makes most of the flat places
// level or upright; with none of them it looked straight ahead. A table seen from straight above is called a wall.
[[nodiscard]] perception::Vec3 up_of(const perception::CostMap& map, const PlaceMemory& memory);

struct NextPlace {
  TouchPlace place;
  int pictures = 0;
  perception::Vec3 via_W = perception::Vec3::Zero();  // on the way to it
};

// In turn a top, a wall, a top, an edge, a corner, where there are such; each where the hand has been least, and where the
// picture shows nothing in its way from `from_W`. `touched`: the places before, in order.
[[nodiscard]] std::optional<NextPlace> next_place(const PlaceMemory& memory,
                                                  const tasks::SceneView& view, const Reach& reach,
                                                  const perception::Vec3& from_W,
                                                  const std::vector<TouchPlace>& touched);

}  // namespace teletact
