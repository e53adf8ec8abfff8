// Checks whether a scripted run did what its script asks: a mark, a path, the robot at the goal.
// Judged only if the whole script of the hand ran; not judged: a shorter run, one that was asked to
// end, one with injected faults or a cut link.
#pragma once

#include <string>

#include "tools/host/run_options.hpp"

namespace teletact {

struct GoalCheck {
  bool asked = false;   // the script marks something within the run, and drives
  bool judged = false;  // false: a goal that is not reached is a note
  std::string missed;   // why the goal is not reached; empty: it is, or nobody asked for one
};

// Largest distance of the robot from the end of its path, in the simulated world (docs/metrics.md:
// robot.goal_error_m).
inline constexpr double kGoalReached_m = 0.10;

[[nodiscard]] GoalCheck check_goal(const Scene&, const DemoOptions&, const OperatorHalf&,
                                   const RobotHalf&);

}  // namespace teletact
