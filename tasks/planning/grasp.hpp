// Grasp planning: how the gripper can take an object from above or from the side, by the object's
// bounding box (tasks/contract/object_list.hpp). Geometry of the youBot's arm and gripper; nothing
// moves an arm yet.
//
// A grasp closes along a horizontal direction: one of the box's axes, projected to the horizontal.
// The gripper comes straight down, or horizontally across the closing direction, away from the
// robot. The fingers go in as deep as they are long, at most to the middle. Of the grasps that fit
// between the fingers and are within reach the narrowest is taken. Of two that are equally narrow
// to a millimetre it is the one from above, then the one whose approach deviates less from the
// direction to the base.
//
// Reach: the base faces the object at any distance at which its front stays clear. Joints 2, 3 and
// 4 turn in one vertical plane. The result is the middle of all base distances at which they reach
// wrist and pitch within their ranges. Joint 1 is straight ahead. Joint 5 turns the closing
// direction; its range of nearly a full turn covers every direction, since the gripper is the same
// after half a turn.
//
// Frames: W world, O object (principal axes), G grasp: origin between the finger tips, z the
// approach, x the closing direction. Angles of the joints from the upright (candle) pose, forward
// positive. Lengths from the vendor's description (URDF chain, data sheet of 2015).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "config/schema.hpp"
#include "perception/geometry/pose.hpp"

namespace tasks {

using perception::Pose;
using perception::Vec3;

// Section [planning.grasp].
struct GraspConfig {
  double opening_most_m = 0.070;  // fingers at their widest mount (data sheet: up to 70 mm)
  double stroke_m = 0.020;        // of both jaws together: nothing thinner than the rest is held
  double clearance_m = 0.004;     // both sides together, while the gripper comes
  double finger_m = 0.040;        // from the tips to what must not touch; assumed
  double before_m = 0.080;        // the point before the grasp, along the approach
  double floor_m = 0.010;         // the tips stay above it
  double front_m = 0.29;          // of the base, from its centre (580 mm long)
  double front_clear_m = 0.05;    // between it and the object
  double shoulder_x_m = 0.200;    // joint 2 before the centre: 143 + 24 + 33 mm
  double shoulder_z_m = 0.255;    // above the floor: 140 + 96 + 19 mm
  double upper_m = 0.155, fore_m = 0.135;
  double hand_m = 0.176;  // joint 4 to the tips: 130 + 46 mm
  std::array<double, 2> range2_deg{-64, 89}, range3_deg{-145, 145}, range4_deg{-102, 102};
  void describe(config::Section& s);
};

struct ObjectBox {
  Pose X_WO = Pose::Identity();
  Vec3 centre_m{0, 0, 0}, extent_m{0, 0, 0};  // in O; extents are whole edges
};

struct Grasp {
  enum class Kind : std::uint8_t { kNone, kTop, kSide };
  enum class Refused : std::uint8_t { kNo, kBadInput, kTooWide, kTooThin, kOutOfReach };
  Kind kind = Kind::kNone;
  Refused refused = Refused::kBadInput;
  Pose X_WG = Pose::Identity();
  Vec3 before_W = Vec3::Zero();  // where the tips are before the last straight way
  double width_m = 0;            // of the object along the closing direction
  double opening_m = 0;          // of the gripper on its way
  // Horizontal distances of the base's centre from the grasp point at which it is within reach: the
  // least, the most, and the middle, with joints 2, 3 and 4 there.
  double base_least_m = 0, base_most_m = 0, base_m = 0;
  std::array<double, 3> joint_rad{};
};

[[nodiscard]] std::string_view text_of(Grasp::Refused refused) noexcept;

// `up_W`: unit vector against gravity; the floor is the plane through `floor_W` normal to it.
// `robot_W`: the base's present place. If there is no grasp it gives one reason: the first of too
// wide, too thin, out of reach that all candidates share.
[[nodiscard]] Grasp find_grasp(const ObjectBox& box, const Vec3& up_W, const Vec3& floor_W,
                               const Vec3& robot_W, const GraspConfig& config) noexcept;

// Joints 2, 3, 4 that bring the wrist (joint 4) to (x, z) from the shoulder with the hand at
// `pitch_rad` from upright; false: not within the ranges.
[[nodiscard]] bool arm_joints(double x_m, double z_m, double pitch_rad, const GraspConfig& config,
                              std::array<double, 3>& joint_rad) noexcept;

}  // namespace tasks
