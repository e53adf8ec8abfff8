// What the other box's messages say to supervision. Pure functions: the nodes (tasks/graph) read
// the edges and ask these.
#pragma once

#include <algorithm>
#include <optional>

#include "rt/time.hpp"
#include "tasks/supervision/supervision_task.hpp"

namespace tasks {

// Operator box. When was the link heard last, as far as supervision is concerned? Not later than
// the robot's state came: a line that carries everything but that is as good as silent. A state
// that came and was made long ago (`state_old`) counts as twice the liveness ago.
[[nodiscard]] inline rt::Time link_heard_with_state(rt::Time line_heard, rt::Time state_came,
                                                    bool state_old, rt::Time now,
                                                    rt::Nanos liveness) noexcept {
  const rt::Time heard = std::min(line_heard, state_came);
  return state_old ? std::min(heard, now - 2 * liveness) : heard;
}

// The operator's acts that a goal carries.
struct GoalAsks {
  int engaged = 0;  // RobotGoal::operator_engaged
  bool clear = false;
};
// Robot box: the operator's requests.
struct PeerAsks {
  SupervisionTask::Engage engage = SupervisionTask::Engage::kAbsent;
  SupervisionTask::Clear clear = SupervisionTask::Clear::kAbsent;
  Mode peer_mode = Mode::kHold;
};
// Engage and clear travel in the goal. Without a goal there is neither, and no release of one
// either.
[[nodiscard]] inline PeerAsks asked_by_goal(const std::optional<GoalAsks>& goal) noexcept {
  using Engage = SupervisionTask::Engage;
  using Clear = SupervisionTask::Clear;
  if (!goal) return {};
  const Engage engage = goal->engaged == 1   ? Engage::kYes
                        : goal->engaged == 2 ? Engage::kPaused
                                             : Engage::kNo;
  return {engage, goal->clear ? Clear::kYes : Clear::kNo,
          engage == Engage::kYes ? Mode::kEngaged : Mode::kHold};
}

}  // namespace tasks
