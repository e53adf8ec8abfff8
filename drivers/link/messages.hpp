// The messages that cross between the boxes, apart from images. Plain data, SI units.
// Wire form: drivers/link/wire.hpp, little-endian, explicit; the schema hash covers this file's
// field lists.
#pragma once

#include <array>
#include <cstdint>

#include "rt/time.hpp"

namespace drivers {

// Planar pose and velocity of the base B in the odometry frame O (starts equal to the world).
struct RobotState {
  std::uint64_t seq = 0;
  rt::Time taken{};
  double x_m = 0, y_m = 0, yaw_rad = 0;       // X_OB
  double vx = 0, vy = 0, wz = 0;              // body frame, m/s, rad/s, measured
  double cmd_vx = 0, cmd_vy = 0, cmd_wz = 0;  // body frame, commanded in the same cycle
  std::uint64_t goal_seq = 0;                 // newest RobotGoal the robot has accepted
  std::uint8_t mode = 0;                      // tasks::Mode of the robot box
  std::uint8_t moving = 0;
  std::uint16_t fault = 0;
};

// Where the base shall go next, made 10 times a second by prediction.
struct RobotGoal {
  std::uint64_t seq = 0;
  rt::Time made{};
  rt::Time valid_until{};                // beyond it the robot holds still
  double x_m = 0, y_m = 0, yaw_rad = 0;  // target pose X_OB
  double vx = 0, vy = 0, wz = 0;         // feed-forward at the target, body frame
  double speed_limit_m_per_s = 0;
  std::uint8_t engaged = 0;           // 0: hold still, whatever the pose says
  std::uint8_t operator_engaged = 0;  // the operator's box is in the engaged mode
  std::uint8_t operator_clear = 0;    // the operator holds the button that clears a safe stop
  std::uint64_t path_seq = 0;
};

}  // namespace drivers
