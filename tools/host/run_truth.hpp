// Where the simulated robot truly was, for figures of a run on rendered images. Nothing of it ever reaches a task.
#pragma once

#include <optional>

#include "perception/geometry/planar.hpp"
#include "tools/host/run_results.hpp"

namespace teletact {

// At an instant of the operator's clock, between two looks of the console; none: before the first or after the last.
[[nodiscard]] std::optional<perception::Pose2> true_base_at(const RobotHalf& robot, rt::Time at);
// What the wheels alone said then; none: not recorded.
[[nodiscard]] std::optional<perception::Pose2> odometry_at(const RobotHalf& robot, rt::Time at);

}  // namespace teletact
