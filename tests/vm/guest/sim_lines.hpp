// The other end of the guest's GPIO lines (gpio-sim): a person's hand at the switches, and what a
// relay or a lamp would see.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <string>

namespace vm {

class SimLines {
 public:
  // Of the chip: /sys/devices/platform/gpio-sim.0/gpiochip0, say.
  explicit SimLines(std::string folder) : folder_(std::move(folder)) {}

  // A closed contact pulls its pin to ground.
  void close(int line) const { put(line, "pull-down"); }
  void open(int line) const { put(line, "pull-up"); }
  // 1 high, 0 low, -1: there is no such line any more.
  [[nodiscard]] int value(int line) const {
    const int fd = ::open(path(line, "value").c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return -1;
    char c = 0;
    const ssize_t n = ::read(fd, &c, 1);
    ::close(fd);
    return n == 1 ? c - '0' : -1;
  }

 private:
  [[nodiscard]] std::string path(int line, const char* what) const {
    return folder_ + "/sim_gpio" + std::to_string(line) + "/" + what;
  }
  void put(int line, const std::string& pull) const {
    const int fd = ::open(path(line, "pull").c_str(), O_WRONLY | O_CLOEXEC);
    if (fd < 0 || ::write(fd, pull.data(), pull.size()) < 0) std::perror(path(line, "").c_str());
    if (fd >= 0) ::close(fd);
  }
  std::string folder_;
};

}  // namespace vm
