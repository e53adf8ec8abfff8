#include "drivers/youbot/arm_gravity.hpp"

#include <cmath>

#include "drivers/youbot/arm_geometry.hpp"

namespace drivers {

ArmAngles arm_gravity_Nm(const ArmAngles& q, const ArmMasses& m) noexcept {
  namespace geo = arm_geometry;
  constexpr double kGravity_m_per_s2 = 9.81;
  const double upper = geo::kAtZero[1] + q[1], fore = upper + geo::kAtZero[2] + q[2];
  const double tilt = fore + geo::kAtZero[3] + q[3];
  // Out from each joint's own axis, of the next joint and of the centre of its link.
  const double elbow = geo::kUpper_m * std::sin(upper), wrist = geo::kFore_m * std::sin(fore);
  // Link 4, and link 5 with what is at the palm: their line stands off joint 4's axis.
  const double held_kg = m.gripper_kg + m.payload_kg;
  const double off_axis = geo::kToolX_m * std::cos(tilt);
  const double hand = m.link_kg[2] * m.centre_m[2] * std::sin(tilt) +
                      m.link_kg[3] * (off_axis + m.centre_m[3] * std::sin(tilt)) +
                      held_kg * (off_axis + geo::kToolZ_m * std::sin(tilt));
  const double hand_kg = m.link_kg[2] + m.link_kg[3] + held_kg;
  const double forearm = m.link_kg[1] * m.centre_m[1] * std::sin(fore) + hand_kg * wrist + hand;
  const double arm =
      m.link_kg[0] * m.centre_m[0] * std::sin(upper) + (m.link_kg[1] + hand_kg) * elbow + forearm;
  return {0, kGravity_m_per_s2 * arm, kGravity_m_per_s2 * forearm, kGravity_m_per_s2 * hand, 0};
}

}  // namespace drivers
