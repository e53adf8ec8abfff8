// The youBot arm's chain as lengths and angles: what its kinematics and its gravity share.
// Source: youbot_description, arm.urdf.xacro.
#pragma once

#include <array>
#include <numbers>

namespace drivers::arm_geometry {

constexpr double radians(double deg) { return deg * 2 * std::numbers::pi / 360; }

// Where the plane of joints 2 to 4 begins, the links, and the angles at q = 0.
inline constexpr double kBaseX_m = 0.024, kBaseZ_m = 0.096, kShoulderX_m = 0.033,
                        kShoulderZ_m = 0.019;
inline constexpr double kUpper_m = 0.155, kFore_m = 0.135, kToolX_m = -0.002, kToolZ_m = 0.130;
inline constexpr std::array<double, 5> kAtZero{radians(170), radians(-65), radians(146),
                                               radians(-102.5), radians(167.5)};

}  // namespace drivers::arm_geometry
