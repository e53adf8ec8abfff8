// The calibration drive on the twin: the virtual base and the synthetic camera of a scene, and
// fusion with the scene's stated mount, on simulated time. The result has what a real robot's log
// would have, and the ground truth beside it.
#pragma once

#include <functional>

#include "rt/memory/non_realtime.hpp"
#include "tools/robot/drive_script.hpp"
#include "tools/robot/identify_robot.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

struct TwinDrive {
  RobotDrive drive;
  RobotModel truth;  // the radii with the mean slip in them: what odometry can know
  int frames = 0, claimed = 0;
};

// What a scene states of its robot.
[[nodiscard]] RobotModel stated_robot(const Scene& scene);

// Throws std::runtime_error: the base runs into something, the scene has no synthetic camera.
// `progress` is called once a simulated second with the seconds so far.
[[nodiscard]] TwinDrive drive_twin(rt::NonRealtime&, const Scene& scene, const DriveScript& script,
                                   const std::function<void(double)>& progress = {});

}  // namespace teletact
