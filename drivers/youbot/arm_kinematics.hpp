// Kinematics of the youBot's arm, both ways, in closed form.
//
// Frames: A, the arm's base plate (z up, x forward); T, the gripper's palm on link 5 (z along the
//   fingers). q as in the robot's description: 0 is where homing ends, joints 1, 2, 4, 5 count up
//   from there, joint 3 down.
// Chain: youbot_description, arm.urdf.xacro: joint 1 about -z, 2 to 4 about y in one plane, 5 about
//   -z of the tool. So the arm has two choices of joint 1 (in front of it, over its shoulder) and
//   two of the elbow, and a pose is reached only if its z axis lies in the plane through joint 1.
// forward    any q.
// inverse    every q within the limits that gives the pose to `tolerance` (m, and as much in a unit
//            vector), at most four; those that fall together are one. On joint 1's own axis the
//            pose does not say where joint 1 is: the plane of the tool's axis is taken, and if
//            that is
//            upright as well, `q1_free`.
// Nothing allocates or throws.
#pragma once

#include <array>

#include "perception/geometry/pose.hpp"

namespace drivers {

inline constexpr int kArmJoints = 5;
using ArmAngles = std::array<double, kArmJoints>;  // rad

struct ArmLimits {
  ArmAngles low{0, 0, -5.1836, 0, 0};
  ArmAngles high{5.8992, 2.7053, 0, 3.5779, 5.8470};
  [[nodiscard]] bool holds(const ArmAngles& q) const noexcept;
};

struct ArmSolutions {
  std::array<ArmAngles, 4> q{};
  int count = 0;
};

[[nodiscard]] perception::Pose arm_forward(const ArmAngles& q) noexcept;
[[nodiscard]] ArmSolutions arm_inverse(const perception::Pose& X_AT, const ArmLimits& = {},
                                       double tolerance = 1e-9, double q1_free = 2.9) noexcept;

}  // namespace drivers
