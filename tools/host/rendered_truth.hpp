// Figures of a run on rendered images, against where the twin's camera truly was.
#pragma once

#include "tools/host/run_results.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

// Of fusion's poses against the twin's; -1 where the camera is not the twin's.
[[nodiscard]] TrackingFigures rendered_figures(const Scene& scene, const OperatorHalf& op,
                                               const RobotHalf& robot);

}  // namespace teletact
