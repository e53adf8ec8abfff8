// The safety chain on GPIO lines: from edges and levels to what robot_io acts on, and back to a
// square wave and a lamp.
//
//   opens at once    an edge to open is a stop in the job that reads it, even if the contact has
//                    closed again by then; so is a level that is open without an edge
//   closes late      a contact counts as closed when it is closed and debounce_ms have passed since
//                    its last edge. The same for a switch that is held
//   not readable     counts as open and as let go
//   heartbeat        one edge every heartbeat_ms while act() says "alive"; never after make_safe().
//                    Where it stops, high or low, is chance: the relay must need edges
//
// sense() costs an ioctl a contact and one read a line; act() one ioctl for each output that
// changes. Nothing waits or allocates.
#pragma once

#include <array>
#include <atomic>

#include "drivers/gpio/gpio_config.hpp"
#include "drivers/gpio/gpio_lines.hpp"
#include "drivers/gpio/safety_io.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::gpio {

class SafetyChain final : public SafetyIo {
 public:
  // `lines` were opened as config.lines() says and outlive this object. Throws
  // std::invalid_argument with one line.
  SafetyChain(rt::NonRealtime&, const GpioConfig& config, GpioLines& lines);

  void sense(rt::Time now, SafetyInputs& out) noexcept override;
  void act(rt::Time now, const SafetyOutputs&) noexcept override;
  void make_safe() noexcept override { safe_.store(true, std::memory_order_release); }
  void allow_again() noexcept override { safe_.store(false, std::memory_order_release); }

 private:
  struct Contact {
    int input = -1;
    bool closed = false;  // debounced; a start counts as open until shown otherwise
    bool level = false;
    rt::Time changed{};
    bool seen = false;
  };
  void take_level(Contact&, rt::Time now, std::uint32_t levels) const noexcept;
  void watch_disagreement(rt::Time now, SafetyInputs& out) noexcept;
  void put(int output, bool active, rt::Time now, bool& last) noexcept;

  GpioLines& lines_;
  GpioConfig::Lines places_;
  rt::Nanos debounce_, disagree_, half_wave_;
  Contact estop_, estop_2_, enable_;
  bool differ_ = false;
  rt::Time differ_since_{};
  rt::Time opened_{};
  bool beat_ = false, lamp_ = false, begun_ = false, failed_ = false;
  rt::Time beat_at_{};
  std::atomic<bool> safe_{false};
};

}  // namespace drivers::gpio
