// The simulated robot's true poses, for figures of a run on rendered images. No task ever gets any
// of it.
#pragma once

#include <optional>

#include "perception/geometry/planar.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

// At an instant of the operator's clock, interpolated between two samples of the console; none:
// before the first or after the last.
[[nodiscard]] std::optional<perception::Pose2> true_base_at(const RobotHalf& robot, rt::Time at);
// What the wheels alone said then; none: not recorded.
[[nodiscard]] std::optional<perception::Pose2> odometry_at(const RobotHalf& robot, rt::Time at);

// Of fusion's poses against the twin's camera (rendered_truth.cpp); -1 where the camera is not the
// twin's.
[[nodiscard]] TrackingFigures rendered_figures(const Scene& scene, const OperatorHalf& op,
                                               const RobotHalf& robot);

}  // namespace teletact
