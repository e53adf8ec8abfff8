#include "drivers/gpio/chip_parts.hpp"

#include <cerrno>
#include <cstring>
#include <ctime>

#include "rt/clock/box_time.hpp"

namespace drivers::gpio {

std::string chip_path(const std::string& name) {
  return !name.empty() && name.front() == '/' ? name : "/dev/" + name;
}

std::string chip_problem(const std::string& what, int error) {
  std::string text = what + ": " + std::strerror(error);
  if (error == EACCES || error == EPERM)
    text += "; give your user the group of the device (often gpio), or a udev rule";
  if (error == ENOENT) text += "; `ls /dev/gpiochip*` shows the chips; see robot.gpio.chip";
  if (error == EBUSY) text += "; another program or driver holds the line: `gpioinfo` says which";
  if (error == EINVAL)
    text += "; the chip has no such line, or not the bias that robot.gpio.bias asks for";
  return text;
}

rt::Time edge_time(std::int64_t kernel_ns, rt::Time now) noexcept {
  constexpr std::int64_t kFar = 1'000'000'000;
  std::int64_t age = rt::monotonic_ns() - kernel_ns;
  if (age < -kFar) {
    timespec wall{};
    clock_gettime(CLOCK_REALTIME, &wall);
    age = wall.tv_sec * 1'000'000'000LL + wall.tv_nsec - kernel_ns;
  }
  return now - rt::Nanos{age < 0 ? 0 : age};
}

}  // namespace drivers::gpio
