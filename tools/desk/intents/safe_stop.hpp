// What a person is told about a safe stop of either box: why it is there, and what ends it.
#pragma once

#include <string>

#include "drivers/link/messages.hpp"
#include "tasks/contract/messages.hpp"

namespace teletact {

// The first cause that only a new start of a program ends; kNoFault: none, a clear is what helps.
[[nodiscard]] rt::FaultId wants_restart(const tasks::ModeMsg& mode,
                                        const drivers::RobotState& robot) noexcept;

// Why no engage is followed, and what to do. Empty: neither box is in a safe stop.
[[nodiscard]] std::string safe_stop_refusal(const tasks::ModeMsg& mode,
                                            const drivers::RobotState& robot);

// Why a clear is not tried. Empty: it is.
[[nodiscard]] std::string clear_refusal(const tasks::ModeMsg& mode,
                                        const drivers::RobotState& robot);

// What a clear has not ended, and what to do. Empty: no box is in a safe stop any more.
[[nodiscard]] std::string still_stopped(const tasks::ModeMsg& mode,
                                        const drivers::RobotState& robot);

}  // namespace teletact
