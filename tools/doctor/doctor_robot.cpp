// What a robot's box needs beside time: CAN interfaces and GPIO chips. A box without them is fine:
// only a scene that names them needs them.
#include <cstdlib>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

using Level = DoctorCheck::Level;

namespace {

constexpr long long kArphrdCan = 280;  // linux/if_arp.h
constexpr long long kMostQueued = 64;

}  // namespace

DoctorCheck can_bus(const Tree& tree) {
  DoctorCheck c{
      "can",
      "CAN interfaces",
      Level::kFine,
      "",
      "motors on a CAN bus (robot.bus.kind = \"can\") need an interface that is up; a long "
      "send queue holds commands that are old by the time they go out",
      ""};
  const std::string folder = "/sys/class/net";
  std::string down;
  for (const char* prefix : {"can", "slcan", "vcan"}) {
    for (const auto& name : tree.numbered(folder, prefix)) {
      const std::string at = folder + "/" + name;
      if (tree.number(at + "/type").value_or(0) != kArphrdCan) continue;
      const bool up =
          (std::strtoul(tree.text(at + "/flags").value_or("0").c_str(), nullptr, 16) & 1U) != 0;
      const long long queue = tree.number(at + "/tx_queue_len").value_or(0);
      c.state += (c.state.empty() ? "" : "; ") + name + (up ? " up" : " down") + ", send queue " +
                 std::to_string(queue);
      if (!up && down.empty()) down = name;
      if (queue > kMostQueued) {
        c.level = Level::kAdvice;
        c.todo = "as root: ip link set " + name + " txqueuelen 10";
      }
    }
  }
  if (!down.empty()) {
    c.level = Level::kAdvice;
    c.todo = "as root: ip link set " + down +
             " up type can bitrate 1000000 restart-ms 0 (the rate of the modules; a vcan takes no "
             "rate), then: teletact can scan --iface " +
             down;
  }
  if (c.state.empty()) c.state = "none; only motors on CAN need one";
  return c;
}

DoctorCheck gpio_chips(const Tree& tree) {
  DoctorCheck c{
      "gpio",
      "GPIO chips",
      Level::kFine,
      "",
      "emergency stop, enable switch and heartbeat (robot.gpio.kind = \"chip\") are lines "
      "of a GPIO chip, which this user must be able to open",
      ""};
  for (const auto& name : tree.numbered("/dev", "gpiochip")) {
    const bool mine = tree.writable("/dev/" + name);
    c.state += (c.state.empty() ? "" : "; ") + name + (mine ? "" : " not for this user");
    if (mine) continue;
    c.level = Level::kAdvice;
    c.todo =
        "give the user the group of /dev/" + name +
        " (often gpio), or add a udev rule: SUBSYSTEM==\"gpio\", GROUP=\"gpio\", MODE=\"0660\"; "
        "then log in again. `gpioinfo` (package gpiod) lists the lines";
  }
  if (c.state.empty()) c.state = "none; only a robot with safety lines needs one";
  return c;
}

}  // namespace teletact::doctor
