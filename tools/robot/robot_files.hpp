// A recorded drive on disk: the wheels' angles as CSV, and the camera's poses as TUM lines.
#pragma once

#include <string>
#include <vector>

#include "rt/result.hpp"
#include "tools/robot/identify_robot.hpp"

namespace teletact {

// Columns t_s,front_left,front_right,back_left,back_right, by name or, without a header, in this
// order. Values are wheel angles in rad, or motor ticks if `ticks_per_motor_turn` > 0; unwrapped,
// with the signs of the robot's own wiring (mecanum.hpp). An error names file and line: a number
// that is not finite, too few columns, time that does not rise, or a leap of more than 30 rad from
// row to row (a counter that wrapped).
[[nodiscard]] rt::Result<std::vector<WheelAngles>> read_wheels(const std::string& path,
                                                               double ticks_per_motor_turn,
                                                               double gear_ratio);
[[nodiscard]] std::string wheels_csv(const std::vector<WheelAngles>& wheels);
// TUM lines, as `teletact fuse --poses` writes the claimed ones.
[[nodiscard]] std::string poses_text(const std::vector<CameraSeen>& cameras);
// The keys for a scene. A parameter that was not constrained is written with its stated value and a
// note.
[[nodiscard]] std::string calibration_toml(const RobotFit& fit, const RobotModel& stated,
                                           const std::string& day);

}  // namespace teletact
