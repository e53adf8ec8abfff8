// Digital lines of one GPIO chip, as the safety chain uses them. "Active" is the logical level: a
// line that is wired active-low is active while its pin is low. Lines are named by their place in
// the lists that they were opened with, inputs first, then outputs.
// Edges tell when, levels tell what is: an edge may be lost, or the switch was open at the start.
#pragma once

#include <cstdint>
#include <span>

#include "rt/time.hpp"

namespace drivers::gpio {

inline constexpr int kMostLines = 8;  // of each direction

struct LineEdge {
  int input = 0;
  bool active = false;  // the level after it
  rt::Time at{};        // the kernel's time of it, as the caller's clock
};

struct Drained {
  int count = 0;
  // Some edges never came: the kernel's queue was full, or a sequence number is missing.
  bool lost = false;
};

class GpioLines {
 public:
  virtual ~GpioLines() = default;
  // Edges since the last call, each line's oldest first, as many as there is room for. Never waits.
  [[nodiscard]] virtual Drained drain(rt::Time now, std::span<LineEdge>) noexcept = 0;
  // Levels of the inputs, a bit each. False: they could not be read, and `active` is untouched.
  [[nodiscard]] virtual bool levels(rt::Time now, std::uint32_t& active) noexcept = 0;
  // False: it was not set.
  [[nodiscard]] virtual bool set(rt::Time now, int output, bool active) noexcept = 0;
};

}  // namespace drivers::gpio
