// Of the operator's console: why the base stands.
#include <cstdio>

#include "tasks/robot_io/robot_io_task.hpp"
#include "tools/host/console.hpp"
#include "tools/record/black_box.hpp"

namespace teletact {

std::string held_text(tasks::Held held, std::int32_t measured_ms, std::int32_t limit_ms) {
  using tasks::Held;
  char text[120] = "";
  switch (held) {
    case Held::kNo:
      break;
    case Held::kStateOld:
      std::snprintf(text, sizeof text, "robot state %d ms old, limit %d ms", measured_ms, limit_ms);
      break;
    case Held::kStateSilent:
      std::snprintf(text, sizeof text, "no robot state arrives, the newest is %d ms old",
                    measured_ms);
      break;
    case Held::kSettling:
      return "waits a moment after robot states that were too old or missing";
    case Held::kDelayUnknown:
      return "the link's round trip is not measured yet";
    case Held::kPlaceUnsure:
      return "its place is not certain enough: turn the camera to a place that it has seen";
    case Held::kModeSilent:
      return "supervision sends no mode";
    case Held::kPathOld:
      return "the path is too old, or planning is silent";
  }
  return text;
}

// A job of prediction is a tenth of a second; where the console saw none, the next one counts for it. Settling keeps
// the reason that it comes from.
void OperatorConsole::mind_held(const tasks::OdometryFrame& newest) {
  using tasks::Held;
  using Phase = tasks::TaskState::Phase;
  const Phase phase = seen_.task.phase;
  if ((phase != Phase::kDriving && phase != Phase::kPlanning) || seen_.engages == 0 ||
      newest.held == Held::kNo || newest.held == Held::kPlaceUnsure)
    return;
  if (seen_.world.seq != 0) seen_.held_s += 0.1 * static_cast<double>(newest.seq - seen_.world.seq);
  if (newest.held == Held::kSettling && seen_.held != Held::kNo) return;
  seen_.held = newest.held;
  seen_.held_ms = newest.held_ms;
  seen_.held_limit_ms = newest.held_limit_ms;
}

// For the status line, once somebody has engaged: why the base may not be driven, or that goals reach the robot too late.
std::string OperatorConsole::stands() const {
  using tasks::Held;
  if (seen_.engages == 0) return {};
  const auto& w = seen_.world;
  if (w.held == Held::kPlaceUnsure) return {};  // stands beside the stated error
  if (w.held != Held::kNo) return "  STANDS: " + held_text(w.held, w.held_ms, w.held_limit_ms);
  using namespace tasks::robot_io_fault;
  if (seen_.robot.fault == kGoalExpired || seen_.robot.fault == kLinkSilent)
    return "  STANDS: " + fault_text(seen_.robot.fault);
  return {};
}

}  // namespace teletact
