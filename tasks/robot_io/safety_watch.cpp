#include "tasks/robot_io/safety_watch.hpp"

namespace tasks {

using drivers::SafetyInputs;
using rt::Health;
using rt::Severity;

Health SafetyWatch::step(const SafetyInputs& in, const ModeMsg* mode) noexcept {
  if (!in.fitted) return Health::ok();
  const Mode now = mode != nullptr ? mode->mode : Mode::kInit;
  const bool pauses = mode != nullptr && mode->resumes && now != Mode::kSafeStop;
  const bool left = was_engaged_ && now != Mode::kEngaged && !pauses;
  if (left || (now == Mode::kSafeStop && last_ != Mode::kSafeStop)) let_go_seen_ = false;
  was_engaged_ = now == Mode::kEngaged || (was_engaged_ && pauses);
  last_ = now;
  if (!in.enable_held) let_go_seen_ = true;

  if (!in.readable) return Health::of(Severity::kSafeStop, robot_io_fault::kLinesUnread);
  if (in.estop_disagrees) return Health::of(Severity::kSafeStop, robot_io_fault::kEstopDisagree);
  if (in.estop_open) return Health::of(Severity::kSafeStop, robot_io_fault::kEstopOpen);
  if (in.enable_fitted && !(in.enable_held && let_go_seen_))
    return Health::of(Severity::kRampDown, robot_io_fault::kNotEnabled);
  if (in.outputs_failed) return Health::of(Severity::kRampDown, robot_io_fault::kLinesUnset);
  if (in.edges_lost) return Health::of(Severity::kCounted, robot_io_fault::kEdgesLost);
  return Health::ok();
}

drivers::SafetyOutputs SafetyWatch::show(const rt::Tick& tick, const SafetyInputs& in,
                                         const ModeMsg* mode, bool bus_down) noexcept {
  drivers::SafetyOutputs out;
  if (!in.fitted) return out;
  const Mode now = mode != nullptr ? mode->mode : Mode::kInit;
  // The clear counts as long as it is pressed: the bus may need the power that the relay gives.
  bus_lost_ = (bus_lost_ || bus_down) && !(mode != nullptr && mode->clear);
  // A job that began a whole period late has missed its turn of the wave.
  out.alive = in.readable && !bus_lost_ && tick.start - tick.release < tick.period;
  switch (now) {
    case Mode::kInit:
      break;
    case Mode::kSafeStop:
      out.lamp = drivers::Lamp::kFast;
      break;
    case Mode::kHold:
    case Mode::kRampDown:
      out.lamp = drivers::Lamp::kSlow;
      break;
    case Mode::kEngaged:
      out.lamp = drivers::Lamp::kOn;
      break;
  }
  return out;
}

}  // namespace tasks
