// libgpiod 1.6: a file descriptor for each input, one read each.
#include <gpiod.h>

#ifdef GPIOD_LINE_BULK_MAX_LINES

#include <fcntl.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <stdexcept>

#include "drivers/gpio/chip_lines.hpp"
#include "drivers/gpio/chip_parts.hpp"

namespace drivers::gpio {

namespace {

constexpr unsigned kKernelQueue = 16;  // edges a line

int bias_flag(const std::string& bias) {
  if (bias == "disabled") return GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
  if (bias == "pull-up") return GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
  if (bias == "pull-down") return GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
  return 0;
}

class ChipLines final : public GpioLines {
 public:
  explicit ChipLines(const GpioConfig& config) : places_(config.lines()) {
    const std::string path = chip_path(config.chip);
    chip_.reset(gpiod_chip_open(path.c_str()));
    if (!chip_) throw std::runtime_error(chip_problem(path, errno));
    const int flags =
        bias_flag(config.bias) | (config.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0);
    for (std::size_t i = 0; i < places_.inputs.size(); ++i) open_input(path, i, flags);
    for (std::size_t i = 0; i < places_.outputs.size(); ++i) {
      output_[i] = take(path, places_.outputs[i]);
      if (gpiod_line_request_output(output_[i], "teletact", 0) != 0)
        throw std::runtime_error(chip_problem(name_of(path, places_.outputs[i]), errno));
    }
  }

  [[nodiscard]] Drained drain(rt::Time now, std::span<LineEdge> out) noexcept override {
    Drained d;
    std::array<gpiod_line_event, kKernelQueue> events{};
    for (std::size_t i = 0; i < places_.inputs.size(); ++i) {
      const std::size_t room = out.size() - static_cast<std::size_t>(d.count);
      const auto want = static_cast<unsigned>(std::min<std::size_t>(room, events.size()));
      if (want == 0) break;
      const int n = gpiod_line_event_read_fd_multiple(fd_[i], events.data(), want);
      if (n <= 0) continue;  // none: EAGAIN; a chip that is gone shows in levels()
      d.lost = d.lost || n == static_cast<int>(kKernelQueue);
      for (int k = 0; k < n; ++k) {
        const gpiod_line_event& e = events[static_cast<std::size_t>(k)];
        const std::int64_t ns = e.ts.tv_sec * 1'000'000'000LL + e.ts.tv_nsec;
        out[static_cast<std::size_t>(d.count++)] = {static_cast<int>(i),
                                                    e.event_type == GPIOD_LINE_EVENT_RISING_EDGE,
                                                    edge_time(ns, now)};
      }
    }
    return d;
  }

  [[nodiscard]] bool levels(rt::Time, std::uint32_t& active) noexcept override {
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < places_.inputs.size(); ++i) {
      const int level = gpiod_line_get_value(input_[i]);
      if (level < 0) return false;
      bits |= level != 0 ? 1U << i : 0U;
    }
    active = bits;
    return true;
  }

  [[nodiscard]] bool set(rt::Time, int output, bool active) noexcept override {
    if (output < 0 || static_cast<std::size_t>(output) >= places_.outputs.size()) return false;
    return gpiod_line_set_value(output_[static_cast<std::size_t>(output)], active ? 1 : 0) == 0;
  }

 private:
  static std::string name_of(const std::string& path, int offset) {
    return path + " line " + std::to_string(offset);
  }
  gpiod_line* take(const std::string& path, int offset) {
    gpiod_line* line = gpiod_chip_get_line(chip_.get(), static_cast<unsigned>(offset));
    if (line == nullptr) throw std::runtime_error(chip_problem(name_of(path, offset), errno));
    return line;
  }
  void open_input(const std::string& path, std::size_t i, int flags) {
    const std::string name = name_of(path, places_.inputs[i]);
    input_[i] = take(path, places_.inputs[i]);
    if (gpiod_line_request_both_edges_events_flags(input_[i], "teletact", flags) != 0)
      throw std::runtime_error(chip_problem(name, errno));
    fd_[i] = gpiod_line_event_get_fd(input_[i]);
    const int old = fcntl(fd_[i], F_GETFL);
    if (old < 0 || fcntl(fd_[i], F_SETFL, old | O_NONBLOCK) != 0)
      throw std::runtime_error(chip_problem(name, errno));
  }
  struct Close {
    void operator()(gpiod_chip* c) const noexcept { gpiod_chip_close(c); }  // and its lines
  };
  GpioConfig::Lines places_;
  std::unique_ptr<gpiod_chip, Close> chip_;
  std::array<gpiod_line*, kMostLines> input_{}, output_{};
  std::array<int, kMostLines> fd_{};
};

}  // namespace

std::unique_ptr<GpioLines> open_chip_lines(rt::NonRealtime&, const GpioConfig& config) {
  return std::make_unique<ChipLines>(config);
}

const char* libgpiod_version() noexcept { return "1.6"; }

}  // namespace drivers::gpio

#endif
