// What the safety lines mean for the base: faults in, what the heartbeat and the lamp show out.
//
//   emergency stop open, contacts that disagree, lines that can not be read    safe stop
//   enable switch not held                                                     ramp down
//
// The enable switch has to be seen let go before it counts as held: at the start, and again after
// each stop. A ramp down that a held engage survives (ModeMsg::resumes) is no stop.
// The heartbeat goes on while the job can tell its lines and has its bus, also in a safe stop: the
// arm has no brakes and is to hold its place. It ends when lines or bus are lost, and after a lost
// bus begins again with the operator's clear.
#pragma once

#include "drivers/gpio/safety_io.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "tasks/contract/messages.hpp"

namespace tasks {

namespace robot_io_fault {
inline constexpr rt::FaultId kEstopOpen = 520;      // safe stop
inline constexpr rt::FaultId kLinesUnread = 521;    // safe stop
inline constexpr rt::FaultId kEstopDisagree = 522;  // safe stop
inline constexpr rt::FaultId kNotEnabled = 523;     // ramp down
inline constexpr rt::FaultId kEdgesLost = 524;      // counted
inline constexpr rt::FaultId kLinesUnset = 525;     // ramp down
}  // namespace robot_io_fault

class SafetyWatch {
 public:
  // The worst of this job's lines; ok without any.
  [[nodiscard]] rt::Health step(const drivers::SafetyInputs&, const ModeMsg* mode) noexcept;
  // What the lines show at the end of the job. `bus_down`: beyond single lost frames.
  [[nodiscard]] drivers::SafetyOutputs show(const rt::Tick&, const drivers::SafetyInputs&,
                                            const ModeMsg* mode, bool bus_down) noexcept;

 private:
  bool let_go_seen_ = false;  // since the last stop
  bool was_engaged_ = false;  // or only paused since
  Mode last_ = Mode::kInit;
  bool bus_lost_ = false;
};

}  // namespace tasks
