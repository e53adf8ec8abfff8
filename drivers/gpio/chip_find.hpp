// Which chip and which lines are meant, where a scene names them by label and by name: the number
// of a chip in /dev changes with the order in which the kernel finds them.
#pragma once

#include <string>
#include <vector>

#include "drivers/gpio/gpio_config.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::gpio {

struct ChipSeen {
  std::string path;                // /dev/gpiochip0
  std::string label;               // "pinctrl-bcm2711"
  std::vector<std::string> lines;  // names by offset; empty: it has none
};

// The chips of this machine that may be opened, by number (the kernel's ioctls, linux/gpio.h).
[[nodiscard]] std::vector<ChipSeen> chips_of_this_machine(rt::NonRealtime&);

struct FoundChip {
  GpioConfig config;  // with path and offsets in place of label and names
  std::string text;   // "/dev/gpiochip4 'pinctrl-rp1', emergency stop on line 5 'GPIO5'"
};

// Throws std::runtime_error with one line: no chip has this label, several have, the chip that is
// named has another one, it has no line of this name or more than one. The line says what there is.
[[nodiscard]] FoundChip find_chip(const GpioConfig&, const std::vector<ChipSeen>&);

}  // namespace drivers::gpio
