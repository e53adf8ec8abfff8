// Everything the tasks can be told, composed of each module's own struct. The sections of a scene
// file that describe the place and the twins belong to the program, not to the tasks.
#pragma once

#include <cstdint>

#include "config/schema.hpp"
#include "tasks/capture/capture_task.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/limits.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tasks/planning/planning_task.hpp"
#include "tasks/prediction/prediction_task.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tasks/supervision/supervision_task.hpp"

namespace tasks {

struct GraphConfig {
  std::uint64_t seed = 1;
  HapticConfig haptic;
  FusionConfig fusion;
  PredictionConfig prediction;
  PlanningConfig planning;
  RobotIoConfig robot_io;
  CaptureConfig capture;
  SupervisionConfig supervision;
  LimitsConfig limits;
  PoolConfig pool;

  void describe(config::Section& s) {
    s.seed("seed", seed, "of planner and every seeded choice of the tasks");
    haptic.describe(s.section("haptic", "touch"));
    fusion.describe(s.section("fusion", "map, tracking, patch"));
    prediction.describe(s.section("prediction", "delay compensation"));
    planning.describe(s.section("planning", "marks to paths"));
    robot_io.describe(s.section("robot_io", "base control"));
    capture.describe(s.section("capture", "image coding"));
    capture.pictures.describe(s.section("link", "between the boxes"));
    supervision.describe(s.section("supervision", "modes and health"));
    limits.describe(s.section("limits", "how old a value may be for who reads it"));
    pool.describe(s.section("pool", "threads beside a task's own"));
  }
};

}  // namespace tasks
