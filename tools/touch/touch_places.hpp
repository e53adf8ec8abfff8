// Keeps the touchable places (view_places.hpp) over successive pictures of the map, and chooses the
// next one.
//
//   seen again    the newest picture shows the surface there: the place moves to where it shows now
//   gone          twice in a row the newest picture looks through it or shows nothing there:
//                 forgotten
//   hidden        something stands before it in the newest picture: not chosen until that has gone
//   out of view   kept unchanged
//
// A place can be chosen if two pictures have shown it, half of those that looked at it since have,
// and the hand can reach it. Frames: W world (= map), D haptic base. SI. Same pictures, same
// places.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "drivers/haptic/workspace_map.hpp"
#include "perception/ground/cost_map.hpp"
#include "tools/touch/view_places.hpp"

namespace teletact {

// The part of W that the hand can reach with the device's workspace at its present place.
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

class TouchPlaces {
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
  // The nearest confirmed place within 80 mm of p, if p is within 15 mm of its plane; null: there
  // is none.
  [[nodiscard]] const Known* at(const perception::Vec3& p_W) const noexcept;

 private:
  std::vector<Known> known_;
};

// The upward direction in W. If the ground was found, it is the ground's normal. Otherwise it is
// estimated: the camera is assumed to start without roll and to look at most 75 degrees down. Of
// the directions that this leaves, the one is taken that makes most of the flat places level or
// upright; without such places the camera is taken to look straight ahead. A table seen from
// straight above is then called a wall.
[[nodiscard]] perception::Vec3 up_of(const perception::CostMap& map, const TouchPlaces& memory);

struct NextPlace {
  TouchPlace place;
  int pictures = 0;
  perception::Vec3 via_W = perception::Vec3::Zero();  // on the way to it
};

// Takes in turn a top, a wall, a top, an edge, a corner, if there are such. Of each kind it takes
// the place that the hand has touched least and whose way from `from_W` is free in the picture.
// `touched`: the places before, in order.
[[nodiscard]] std::optional<NextPlace> next_place(const TouchPlaces& memory,
                                                  const tasks::SceneView& view, const Reach& reach,
                                                  const perception::Vec3& from_W,
                                                  const std::vector<TouchPlace>& touched);

}  // namespace teletact
