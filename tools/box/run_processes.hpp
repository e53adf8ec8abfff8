// The demo on the real clock: this process admits both boxes, then runs them as two child processes
// that talk over loopback TCP, and makes the report from what they leave.
#pragma once

#include <stdexcept>

#include "tools/host/run_options.hpp"

namespace teletact {

struct RealRun {
  OperatorHalf op;
  RobotHalf robot;
  Effects effects;
  rt::Admission admission;
  rt::ModeTable modes;
  std::vector<rt::BestEffortLoad> best_effort;
  std::vector<std::string> problems, notes;
};
// Not admitted, or no room beside what runs already: nothing was started. Exit code 3.
struct CouldNotStart : std::runtime_error {
  using std::runtime_error::runtime_error;
};
// Sets the scene's voxel size to what was admitted.
[[nodiscard]] RealRun run_processes(rt::NonRealtime&, Scene&, const DemoOptions&,
                                    const tasks::Calibration&);

}  // namespace teletact
