// What the arm's own weight does to its joints, in closed form.
//
// Joints 2 to 4 turn in one upright plane about parallel axes (arm_kinematics.hpp). With a_k the
// tilt of link k from upright and l_k the links' lengths, the height of everything behind joint j
// gives the torque  t_j = g * sum over the links k >= j of  m_k * (x_k - x_j),  where x is the way
// out from joint 1's axis in that plane: a weight in front of a joint bends it further forward.
// Joint 1 is upright and bears nothing. Joint 5 turns about the tool's axis, on which its link's
// centre of mass is taken to lie, so it bears nothing either.
// The base stands upright. Nothing allocates or throws.
#pragma once

#include <array>

#include "drivers/youbot/arm_kinematics.hpp"

namespace drivers {

// Masses of what joints 2 to 5 move and where along their link (from the joint before it) each
// centre of mass lies. Source: youbot_description, limits.urdf.xacro, whose frames are not stated:
// read here as CAD frames with one axis along the link, the offsets across it (below 3 cm) left
// out. Link 5 counts from joint 4's axis, with the gripper (0.245 kg: operating instructions) and
// what it holds at the palm.
struct ArmMasses {
  std::array<double, 4> link_kg{1.155, 0.934, 0.877, 0.251};
  std::array<double, 4> centre_m{0.1045, 0.0967, 0.0510, 0.1132};
  double gripper_kg = 0.245, payload_kg = 0;
};

// Torque of gravity about each joint, in the joint's own direction of q, Nm.
[[nodiscard]] ArmAngles arm_gravity_Nm(const ArmAngles& q, const ArmMasses& = {}) noexcept;

}  // namespace drivers
