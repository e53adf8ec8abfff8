// Section [robot.gpio]: which lines of which chip, and how long they must be quiet.
#pragma once

#include <string>
#include <vector>

#include "config/schema.hpp"

namespace drivers::gpio {

struct GpioConfig {
  std::string kind = "none";  // "twin", "chip"
  static constexpr const char* kDefaultChip = "/dev/gpiochip0";
  std::string chip = kDefaultChip;  // or its name in /dev
  // What the chip says that it is (`gpiodetect`); empty: not asked. With it `chip` may be left out.
  std::string label;
  // Offsets on the chip; -1: not fitted.
  int estop_line = 0, estop_line_2 = -1, enable_line = -1, heartbeat_line = -1, lamp_line = -1;
  // In place of an offset, the name that the chip gives the line (`gpioinfo`); empty: by offset.
  std::string estop_name, estop_2_name, enable_name, heartbeat_name, lamp_name;
  // A closed contact, or a held switch, pulls its pin to ground.
  bool active_low = true;
  std::string bias = "as-is";
  double debounce_ms = 20;
  double disagree_ms = 50;
  double heartbeat_ms = 2;  // between two edges

  void describe(config::Section& s);
  // Offsets in the order of Input and Output, those that are fitted. Throws std::invalid_argument
  // with one line if two lines share an offset. A line that has a name and no offset yet is fitted,
  // at an offset that no chip has.
  struct Lines {
    std::vector<int> inputs, outputs;
    int estop = -1, estop_2 = -1, enable = -1, heartbeat = -1, lamp = -1;  // places in the lists
  };
  [[nodiscard]] Lines lines() const;
  [[nodiscard]] bool fitted() const noexcept { return kind != "none"; }
};

}  // namespace drivers::gpio
