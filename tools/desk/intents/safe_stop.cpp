#include "tools/desk/intents/safe_stop.hpp"

#include "tasks/supervision/fault_ids.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

using tasks::Mode;

namespace {

bool robot_stopped(const drivers::RobotState& robot) noexcept {
  return static_cast<Mode>(robot.mode) == Mode::kSafeStop;
}

}  // namespace

rt::FaultId wants_restart(const tasks::ModeMsg& mode, const drivers::RobotState& robot) noexcept {
  const auto wants = [](rt::FaultId id) {
    const int row = tasks::fault_row(id);
    return row >= 0 &&
           tasks::kFaultTable[static_cast<std::size_t>(row)].clear == tasks::ClearRule::kRestart;
  };
  if (mode.mode == Mode::kSafeStop && wants(mode.cause)) return mode.cause;
  if (robot_stopped(robot) && wants(robot.mode_cause)) return robot.mode_cause;
  return rt::kNoFault;
}

std::string safe_stop_refusal(const tasks::ModeMsg& mode, const drivers::RobotState& robot) {
  std::string text;
  if (mode.mode == Mode::kSafeStop)
    text = "a safe stop, " + cause_text(mode.cause, robot);
  else if (robot_stopped(robot))
    text = "the robot's box is in a safe stop, " + fault_text(robot.mode_cause);
  else
    return text;
  const rt::FaultId restart = wants_restart(mode, robot);
  if (restart == rt::kNoFault) return text + ": clear it first";
  // It may be the other box's, behind a cause of this one that a clear would end.
  if (text.find(fault_text(restart)) == std::string::npos)
    text += ", and at the robot " + fault_text(restart);
  return text + fault_advice(restart);
}

std::string clear_refusal(const tasks::ModeMsg& mode, const drivers::RobotState& robot) {
  if (mode.mode != Mode::kSafeStop && !robot_stopped(robot))
    return "there is no safe stop to clear";
  const rt::FaultId restart = wants_restart(mode, robot);
  if (restart == rt::kNoFault) return {};
  return "no clear helps: " + fault_text(restart) + fault_advice(restart);
}

std::string still_stopped(const tasks::ModeMsg& mode, const drivers::RobotState& robot) {
  if (mode.mode == Mode::kSafeStop)
    return "still in a safe stop, " + cause_text(mode.cause, robot) + fault_advice(mode.cause);
  if (robot_stopped(robot))
    return "the robot's box is still in a safe stop, " + fault_text(robot.mode_cause) +
           fault_advice(robot.mode_cause);
  return {};
}

}  // namespace teletact
