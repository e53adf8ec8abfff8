// Finds places that a hand can touch in one picture of the fused map
// (tasks/contract/scene_view.hpp).
//
//   top, wall, slope   on all sides the surface within 60 mm of the point lies on a plane fitted to
//                      it; that plane is level, upright, or neither
//   edge, corner       the same on one side, or in one quarter; on the others the picture shows
//                      surface that lies behind
//
// In addition nothing stands over the place, the way along its normal up to 55 mm was seen free, it
// is not seen at a grazing angle, and nothing moves there. The picture shows only surface with
// enough weight (fusion.view_min_weight), so all of a place was seen that often.
//
// Frames: W world (= map), V the picture's eye. SI. Same picture, same places.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "tasks/contract/scene_view.hpp"

namespace teletact {

struct TouchPlace {
  enum class Kind : std::uint8_t { kTop, kWall, kSlope, kEdge, kCorner };
  static constexpr int kKinds = 5;
  Kind kind = Kind::kTop;
  perception::Vec3 p_W = perception::Vec3::Zero();
  perception::Vec3 n_W = perception::Vec3::UnitZ();  // outward, unit
  double rough_m = 0;                                // RMS off the plane
  bool wide = false;                                 // flat for 100 mm around
  [[nodiscard]] bool flat() const noexcept { return kind <= Kind::kSlope; }
};
[[nodiscard]] const char* name_of(TouchPlace::Kind kind) noexcept;

// Of the picture's pixel: distance along the eye's axis to the surface that shows there; 0: none,
// or outside.
[[nodiscard]] double shown_depth(const tasks::SceneView& view,
                                 const perception::Vec3& p_V) noexcept;

// `up_W`: unit, what is level. `wanted`: points where a place would be of use; empty: anywhere.
[[nodiscard]] std::vector<TouchPlace> places_in_view(
    const tasks::SceneView& view, const perception::Vec3& up_W,
    const std::function<bool(const perception::Vec3& p_W)>& wanted);

}  // namespace teletact
