// Did a scripted run do what its script asks: a mark, a path, the robot at the goal? Judged when the whole script of
// the hand ran; a shorter run, one that was asked to end, and one with faults or a cut cable on purpose are not.
#pragma once

#include <string>

#include "tools/host/run_demo.hpp"

namespace teletact {

struct GoalCheck {
  bool asked = false;   // the script marks something within the run, and drives
  bool judged = false;  // false: a goal that is not reached is a note
  std::string missed;   // why the goal is not reached; empty: it is, or nobody asked for one
};

// Farthest that the robot may stand from the end of its path, in the simulated world. docs/metrics.md: robot.goal_error_m.
inline constexpr double kGoalReached_m = 0.10;

[[nodiscard]] GoalCheck check_goal(const Scene&, const DemoOptions&, const OperatorHalf&,
                                   const RobotHalf&);

}  // namespace teletact
