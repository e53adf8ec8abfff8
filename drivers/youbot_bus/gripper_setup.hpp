// The gripper of a youBot's arm: TMCL module 1 behind the mailbox of joint 5, two stepper motors, a
// bar each. It is no slave of its own, and has no process data.
//
//   look     there or not (user variable 16 is answered), firmware, is it calibrated, and the
//            limits of each bar as the board has them. Moves nothing.
//   set_up   stallGuard threshold 50 and filter on, each bar; then, unless it is calibrated, opened
//            by 66000 counts (11.5 mm a bar), closed by as much, and 0 set there. At most 8 s.
// Source: youbot_driver, YouBotGripper.cpp: order, values, times. It asks each 100 ms whether a bar
// is there (parameter 8) and goes on after 4 s all the same, as a bar that stands at its end never
// is. MST before the zero: a second driver. No source has values for the bars' greatest speed and
// current (parameters 4, 6, 7): they are read and left as they are.
// Nothing here asks a person: the caller does, before set_up().
#pragma once

#include <array>

#include "drivers/youbot_bus/youbot_setup.hpp"

namespace drivers::youbot_bus {

struct GripperBar {
  std::int32_t max_speed = 0;                         // 0 to 2047, the board's own unit
  std::int32_t max_current = 0, standby_current = 0;  // 0 to 255
};

struct GripperReport {
  std::size_t position = 0;  // on the bus: its arm's joint 5
  std::string name;          // "arm 1 gripper"
  tmcl::Firmware firmware;   // controller 842; 0: its text is not known
  bool calibrated = false;
  std::array<GripperBar, 2> bars;
  std::string wrong;  // what it did not tell, and why; empty: nothing
};

// One entry for each arm that has one. A joint 5 without one answers that it does not know it.
[[nodiscard]] rt::Result<std::vector<GripperReport>> look_at_grippers(DriveSession&);

[[nodiscard]] rt::Result<bool> set_up_gripper(DriveSession&, const GripperReport&, const Progress&);

}  // namespace drivers::youbot_bus
