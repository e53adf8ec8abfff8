// libgpiod 2.x: one request for the inputs, one for the outputs.
#include <gpiod.h>

#ifndef GPIOD_LINE_BULK_MAX_LINES

#include <fcntl.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <new>
#include <stdexcept>

#include "drivers/gpio/chip_lines.hpp"
#include "drivers/gpio/chip_parts.hpp"

namespace drivers::gpio {

namespace {

constexpr std::size_t kEdges = 64;  // kept by the kernel for the request, and read at once

template <class T, void (*free_it)(T*)>
struct Freed {
  void operator()(T* p) const noexcept { free_it(p); }
};
template <class T, void (*free_it)(T*)>
using Owned = std::unique_ptr<T, Freed<T, free_it>>;
using Chip = Owned<gpiod_chip, gpiod_chip_close>;
using Settings = Owned<gpiod_line_settings, gpiod_line_settings_free>;
using LineConfig = Owned<gpiod_line_config, gpiod_line_config_free>;
using RequestConfig = Owned<gpiod_request_config, gpiod_request_config_free>;
using Request = Owned<gpiod_line_request, gpiod_line_request_release>;
using Buffer = Owned<gpiod_edge_event_buffer, gpiod_edge_event_buffer_free>;

gpiod_line_bias bias_of(const std::string& bias) {
  if (bias == "disabled") return GPIOD_LINE_BIAS_DISABLED;
  if (bias == "pull-up") return GPIOD_LINE_BIAS_PULL_UP;
  if (bias == "pull-down") return GPIOD_LINE_BIAS_PULL_DOWN;
  return GPIOD_LINE_BIAS_AS_IS;
}

Request request_lines(gpiod_chip* chip, const std::string& path, const std::vector<int>& offsets,
                      gpiod_line_settings* settings) {
  const LineConfig lines(gpiod_line_config_new());
  const RequestConfig config(gpiod_request_config_new());
  if (settings == nullptr || !lines || !config) throw std::bad_alloc();
  const std::vector<unsigned> list(offsets.begin(), offsets.end());
  gpiod_request_config_set_consumer(config.get(), "teletact");
  gpiod_request_config_set_event_buffer_size(config.get(), kEdges);
  Request request;
  if (gpiod_line_config_add_line_settings(lines.get(), list.data(), list.size(), settings) == 0)
    request.reset(gpiod_chip_request_lines(chip, config.get(), lines.get()));
  if (!request) throw std::runtime_error(chip_problem(path + ": its lines", errno));
  return request;
}

class ChipLines final : public GpioLines {
 public:
  explicit ChipLines(const GpioConfig& config) : places_(config.lines()) {
    const std::string path = chip_path(config.chip);
    chip_.reset(gpiod_chip_open(path.c_str()));
    if (!chip_) throw std::runtime_error(chip_problem(path, errno));
    const Settings in(gpiod_line_settings_new());
    const Settings out(gpiod_line_settings_new());
    buffer_.reset(gpiod_edge_event_buffer_new(kEdges));
    if (!in || !out || !buffer_) throw std::bad_alloc();
    gpiod_line_settings_set_direction(in.get(), GPIOD_LINE_DIRECTION_INPUT);
    gpiod_line_settings_set_edge_detection(in.get(), GPIOD_LINE_EDGE_BOTH);
    gpiod_line_settings_set_bias(in.get(), bias_of(config.bias));
    gpiod_line_settings_set_active_low(in.get(), config.active_low);
    gpiod_line_settings_set_event_clock(in.get(), GPIOD_LINE_CLOCK_MONOTONIC);
    gpiod_line_settings_set_direction(out.get(), GPIOD_LINE_DIRECTION_OUTPUT);
    inputs_ = request_lines(chip_.get(), path, places_.inputs, in.get());
    if (!places_.outputs.empty())
      outputs_ = request_lines(chip_.get(), path, places_.outputs, out.get());
    for (std::size_t i = 0; i < places_.inputs.size(); ++i)
      offset_[i] = static_cast<unsigned>(places_.inputs[i]);
    const int fd = gpiod_line_request_get_fd(inputs_.get());
    const int old = fcntl(fd, F_GETFL);
    if (old < 0 || fcntl(fd, F_SETFL, old | O_NONBLOCK) != 0)
      throw std::runtime_error(chip_problem(path, errno));
  }

  [[nodiscard]] Drained drain(rt::Time now, std::span<LineEdge> out) noexcept override {
    Drained d;
    const std::size_t want = std::min(out.size(), kEdges);
    const int n = gpiod_line_request_read_edge_events(inputs_.get(), buffer_.get(), want);
    for (int k = 0; k < n; ++k) {
      gpiod_edge_event* e =
          gpiod_edge_event_buffer_get_event(buffer_.get(), static_cast<unsigned long>(k));
      const unsigned long number = gpiod_edge_event_get_global_seqno(e);
      d.lost = d.lost || number != last_number_ + 1;
      last_number_ = number;
      const int input = place_of(gpiod_edge_event_get_line_offset(e));
      if (input < 0) continue;
      const bool up = gpiod_edge_event_get_event_type(e) == GPIOD_EDGE_EVENT_RISING_EDGE;
      const auto ns = static_cast<std::int64_t>(gpiod_edge_event_get_timestamp_ns(e));
      out[static_cast<std::size_t>(d.count++)] = {input, up, edge_time(ns, now)};
    }
    return d;
  }

  [[nodiscard]] bool levels(rt::Time, std::uint32_t& active) noexcept override {
    std::array<gpiod_line_value, kMostLines> value{};
    const std::size_t n = places_.inputs.size();
    if (gpiod_line_request_get_values_subset(inputs_.get(), n, offset_.data(), value.data()) != 0)
      return false;
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < n; ++i) bits |= value[i] == GPIOD_LINE_VALUE_ACTIVE ? 1U << i : 0U;
    active = bits;
    return true;
  }

  [[nodiscard]] bool set(rt::Time, int output, bool active) noexcept override {
    if (output < 0 || static_cast<std::size_t>(output) >= places_.outputs.size()) return false;
    const auto offset = static_cast<unsigned>(places_.outputs[static_cast<std::size_t>(output)]);
    return gpiod_line_request_set_value(
               outputs_.get(), offset,
               active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE) == 0;
  }

 private:
  [[nodiscard]] int place_of(unsigned offset) const noexcept {
    for (std::size_t i = 0; i < places_.inputs.size(); ++i)
      if (offset_[i] == offset) return static_cast<int>(i);
    return -1;
  }

  GpioConfig::Lines places_;
  Chip chip_;
  Request inputs_, outputs_;
  Buffer buffer_;
  std::array<unsigned, kMostLines> offset_{};
  unsigned long last_number_ = 0;
};

}  // namespace

std::unique_ptr<GpioLines> open_chip_lines(rt::NonRealtime&, const GpioConfig& config) {
  return std::make_unique<ChipLines>(config);
}

const char* libgpiod_version() noexcept { return "2"; }

}  // namespace drivers::gpio

#endif
