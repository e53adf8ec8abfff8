#include "drivers/gpio/chip_find.hpp"

#include <fcntl.h>
#include <linux/gpio.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "drivers/gpio/chip_parts.hpp"

namespace drivers::gpio {

namespace {

// Of a field of the kernel's, which need not end with a zero byte; what a terminal would take for
// something else is a question mark.
template <std::size_t N>
std::string text_of(const char (&field)[N]) {
  std::string out(field, strnlen(field, N));
  for (char& c : out)
    if (c < ' ' || c > '~') c = '?';
  return out;
}

bool look_at(const std::string& path, ChipSeen& out) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return false;
  gpiochip_info chip{};
  const bool told = ::ioctl(fd, GPIO_GET_CHIPINFO_IOCTL, &chip) == 0;
  out = {path, text_of(chip.label), {}};
  constexpr std::uint32_t kMostLines = 1024;
  for (std::uint32_t i = 0; told && i < std::min(chip.lines, kMostLines); ++i) {
    gpio_v2_line_info line{};
    line.offset = i;
    const bool named = ::ioctl(fd, GPIO_V2_GET_LINEINFO_IOCTL, &line) == 0;
    out.lines.push_back(named ? text_of(line.name) : std::string());
  }
  ::close(fd);
  return told;
}

std::string quoted(const std::string& text) { return "'" + text + "'"; }

std::string list_of(const std::vector<ChipSeen>& chips) {
  std::string out;
  for (const ChipSeen& c : chips) out += (out.empty() ? "" : ", ") + c.path + " " + quoted(c.label);
  return out.empty() ? "none that this user may open" : out;
}

const ChipSeen* of_path(const std::vector<ChipSeen>& chips, const std::string& path) {
  const auto at =
      std::find_if(chips.begin(), chips.end(), [&](const ChipSeen& c) { return c.path == path; });
  return at == chips.end() ? nullptr : &*at;
}

// The chip that is meant; null: it is not among those that can be looked at, and nothing depends on
// it: who opens it says why it can not be opened.
const ChipSeen* chosen(const GpioConfig& c, const std::vector<ChipSeen>& chips) {
  const std::string path = chip_path(c.chip);
  const ChipSeen* named = of_path(chips, path);
  if (c.label.empty()) return named;
  const std::string asked = "robot.gpio.label = \"" + c.label + "\": ";
  std::vector<const ChipSeen*> fit;
  for (const ChipSeen& chip : chips)
    if (chip.label == c.label) fit.push_back(&chip);
  if (fit.empty())
    throw std::runtime_error(asked + "no chip has this label; there are " + list_of(chips));
  if (c.chip != GpioConfig::kDefaultChip) {
    if (named != nullptr && named->label == c.label) return named;
    throw std::runtime_error(asked + path +
                             (named != nullptr ? " has the label " + quoted(named->label)
                                               : std::string(" is not there")) +
                             "; there are " + list_of(chips));
  }
  if (fit.size() > 1)
    throw std::runtime_error(asked + std::to_string(fit.size()) +
                             " chips have this label, so robot.gpio.chip has to say which; there "
                             "are " +
                             list_of(chips));
  return fit.front();
}

int offset_of(const ChipSeen& chip, const std::string& name, const char* key) {
  const std::string asked = "robot.gpio." + std::string(key) + " = \"" + name + "\": ";
  const auto n = std::count(chip.lines.begin(), chip.lines.end(), name);
  if (n == 1)
    return static_cast<int>(std::find(chip.lines.begin(), chip.lines.end(), name) -
                            chip.lines.begin());
  if (n > 1)
    throw std::runtime_error(asked + std::to_string(n) + " lines of " + chip.path +
                             " have this name: give the number of the line");
  std::string there;
  int more = 0;
  constexpr std::size_t kMostText = 300;
  for (const std::string& line : chip.lines) {
    if (line.empty()) continue;
    if (there.size() > kMostText)
      ++more;
    else
      there += (there.empty() ? "" : ", ") + line;
  }
  if (more > 0) there += " and " + std::to_string(more) + " more";
  throw std::runtime_error(
      asked + "no line of " + chip.path + " " + quoted(chip.label) + " has this name; " +
      (there.empty() ? "its lines have no names: give numbers" : "its lines are " + there));
}

}  // namespace

std::vector<ChipSeen> chips_of_this_machine(rt::NonRealtime&) {
  namespace fs = std::filesystem;
  std::vector<std::string> paths;
  std::error_code none;
  for (const fs::directory_entry& e : fs::directory_iterator("/dev", none))
    if (e.path().filename().string().starts_with("gpiochip")) paths.push_back(e.path().string());
  // By number: gpiochip10 behind gpiochip9.
  std::sort(paths.begin(), paths.end(), [](const std::string& a, const std::string& b) {
    return a.size() != b.size() ? a.size() < b.size() : a < b;
  });
  std::vector<ChipSeen> out;
  for (const std::string& path : paths)
    if (ChipSeen chip; look_at(path, chip)) out.push_back(std::move(chip));
  return out;
}

FoundChip find_chip(const GpioConfig& c, const std::vector<ChipSeen>& chips) {
  FoundChip out{c, {}};
  const ChipSeen* chip = chosen(c, chips);
  struct Line {
    const char *key, *what;
    const std::string& name;
    int& offset;
  };
  const std::array<Line, 5> lines{
      {{"estop_name", "emergency stop", c.estop_name, out.config.estop_line},
       {"estop_2_name", "its second contact", c.estop_2_name, out.config.estop_line_2},
       {"enable_name", "enable switch", c.enable_name, out.config.enable_line},
       {"heartbeat_name", "heartbeat", c.heartbeat_name, out.config.heartbeat_line},
       {"lamp_name", "lamp", c.lamp_name, out.config.lamp_line}}};
  out.config.chip = chip != nullptr ? chip->path : chip_path(c.chip);
  out.text = out.config.chip + (chip != nullptr ? " " + quoted(chip->label) : std::string());
  for (const Line& line : lines) {
    if (!line.name.empty()) {
      if (chip == nullptr)
        throw std::runtime_error("robot.gpio." + std::string(line.key) + " = \"" + line.name +
                                 "\": " + out.config.chip +
                                 " is not there, or this user may not "
                                 "open it; there are " +
                                 list_of(chips));
      line.offset = offset_of(*chip, line.name, line.key);
    }
    if (line.offset < 0) continue;
    out.text += std::string(", ") + line.what + " on line " + std::to_string(line.offset);
    const auto i = static_cast<std::size_t>(line.offset);
    if (chip != nullptr && i < chip->lines.size() && !chip->lines[i].empty())
      out.text += " " + quoted(chip->lines[i]);
  }
  return out;
}

}  // namespace drivers::gpio
