#include "drivers/gpio/gpio_config.hpp"

#include <algorithm>
#include <stdexcept>

namespace drivers::gpio {

void GpioConfig::describe(config::Section& s) {
  s.text("kind", kind, {"none", "twin", "chip"},
         "safety lines: none, simulated, or of a GPIO chip (simulated where no device is opened)");
  s.text("chip", chip, {}, "path of the chip, or its name in /dev");
  s.text("label", label, {},
         "label of the chip, as gpiodetect shows it: the chip is found by it, and one that has "
         "another label is refused; empty: any");
  s.integer("estop_line", estop_line, -1, 1023,
            "line of the emergency stop's normally closed contact; -1: not fitted");
  s.integer("estop_line_2", estop_line_2, -1, 1023, "its second contact; -1: not fitted");
  s.integer("enable_line", enable_line, -1, 1023, "the enable switch; -1: not fitted");
  s.integer("heartbeat_line", heartbeat_line, -1, 1023,
            "square wave for the watchdog relay; -1: not fitted");
  s.integer("lamp_line", lamp_line, -1, 1023, "status lamp; -1: not fitted");
  s.text("estop_name", estop_name, {},
         "name of the line, as gpioinfo shows it, in place of estop_line; the same for the others");
  s.text("estop_2_name", estop_2_name, {}, "in place of estop_line_2");
  s.text("enable_name", enable_name, {}, "in place of enable_line");
  s.text("heartbeat_name", heartbeat_name, {}, "in place of heartbeat_line");
  s.text("lamp_name", lamp_name, {}, "in place of lamp_line");
  s.flag("active_low", active_low, "a closed contact pulls its pin to ground");
  s.text("bias", bias, {"as-is", "disabled", "pull-up", "pull-down"},
         "the chip's own resistors at the inputs; not every chip has them");
  s.number("debounce_ms", debounce_ms, 0, 1000,
           "a contact counts as closed after this time without an edge; it opens at once");
  s.number("disagree_ms", disagree_ms, 1, 10000,
           "the two contacts of the emergency stop may differ for this long");
  s.number("heartbeat_ms", heartbeat_ms, 1, 100, "from one edge of the heartbeat to the next");
}

GpioConfig::Lines GpioConfig::lines() const {
  Lines out;
  std::vector<int> used;
  int by_name = 2000;
  const auto add = [&](int offset, const std::string& name, std::vector<int>& list, int& place,
                       const char* key) {
    if (!name.empty() && offset < 0) offset = by_name++;
    if (offset < 0) return;
    if (std::find(used.begin(), used.end(), offset) != used.end()) {
      throw std::invalid_argument("robot.gpio." + std::string(key) + " = " +
                                  std::to_string(offset) + ": this line has another use already");
    }
    used.push_back(offset);
    place = static_cast<int>(list.size());
    list.push_back(offset);
  };
  add(estop_line, estop_name, out.inputs, out.estop, "estop_line");
  add(estop_line_2, estop_2_name, out.inputs, out.estop_2, "estop_line_2");
  add(enable_line, enable_name, out.inputs, out.enable, "enable_line");
  add(heartbeat_line, heartbeat_name, out.outputs, out.heartbeat, "heartbeat_line");
  add(lamp_line, lamp_name, out.outputs, out.lamp, "lamp_line");
  if (out.estop < 0)
    throw std::invalid_argument(
        "robot.gpio.estop_line = -1: a robot with safety lines has an emergency stop");
  return out;
}

}  // namespace drivers::gpio
