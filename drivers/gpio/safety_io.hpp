// The lines that stop the robot, as robot_io sees them: read once at the start of a job, written
// once at its end. A robot without such lines has no object of this kind.
//
//   emergency stop   one or two normally closed contacts. Open is a press, a cut wire or a lost
//                    supply: each is a stop
//   enable switch    held by a person near the robot (dead-man). Open is "let go"
//   heartbeat        a square wave that an external watchdog relay needs to see, or it cuts the
//                    motors' power. It is made by the job that drives the motors: it ends with it
//   status lamp      on: the wheels may turn; slow: stands, can be engaged; fast: stopped, see why
#pragma once

#include <cstdint>

#include "rt/time.hpp"

namespace drivers {

struct SafetyInputs {
  bool fitted = false;           // there is a safety chain
  bool readable = false;         // its levels were read in this job
  bool estop_open = false;       // or may be: not readable counts as open
  bool estop_disagrees = false;  // one contact open and the other closed, for too long
  bool enable_fitted = false;
  bool enable_held = false;
  bool edges_lost = false;      // in this job
  bool outputs_failed = false;  // heartbeat or lamp could not be set in the last job
  rt::Time estop_opened{};      // the newest edge to open; zero: none seen. Not recorded
};

enum class Lamp : std::uint8_t { kOff, kSlow, kFast, kOn };

struct SafetyOutputs {
  bool alive = false;  // this job is in control: the heartbeat goes on
  Lamp lamp = Lamp::kOff;
};

// A recording keeps the inputs of a job in one byte.
[[nodiscard]] std::uint8_t to_byte(const SafetyInputs&) noexcept;
[[nodiscard]] SafetyInputs safety_inputs_of(std::uint8_t) noexcept;

class SafetyIo {
 public:
  virtual ~SafetyIo() = default;
  virtual void sense(rt::Time now, SafetyInputs& out) noexcept = 0;
  virtual void act(rt::Time now, const SafetyOutputs&) noexcept = 0;
  // From any thread, even while the owner hangs: no more heartbeat until allow_again().
  virtual void make_safe() noexcept {}
  virtual void allow_again() noexcept {}
};

}  // namespace drivers
