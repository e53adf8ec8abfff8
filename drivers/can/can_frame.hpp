// A classic CAN frame, and what an error frame of the kernel says (linux/can/error.h).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "rt/time.hpp"

namespace drivers::can {

inline constexpr std::uint32_t kStandardIds = 0x7FF, kExtendedIds = 0x1FFFFFFF;

struct CanFrame {
  std::uint32_t id = 0;
  bool extended = false, remote = false;
  std::uint8_t length = 0;  // 0..8
  std::array<std::uint8_t, 8> data{};
  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept {
    return std::span(data).first(length);
  }
  friend bool operator==(const CanFrame&, const CanFrame&) = default;
};

// False: more than eight bytes.
[[nodiscard]] bool fill(CanFrame&, std::uint32_t id, std::span<const std::uint8_t>) noexcept;

// What the controller says of the bus.
enum class BusState : std::uint8_t { kActive, kWarning, kPassive, kBusOff };
[[nodiscard]] const char* to_text(BusState) noexcept;

struct ErrorReport {
  bool state_known = false;
  BusState state = BusState::kActive;
  bool restarted = false;              // the controller left bus-off
  bool no_ack = false;                 // nobody is there: power off, or alone on the bus
  bool overflow = false;               // of the controller's own memory: frames were lost
  bool protocol = false;               // bit, stuff, form or checksum error on the wire
  int tx_errors = -1, rx_errors = -1;  // counters; -1: not told
};
// Of an error frame's identifier (with or without its flag bit) and its eight bytes.
[[nodiscard]] ErrorReport read_error(std::uint32_t id,
                                     std::span<const std::uint8_t, 8> data) noexcept;

// Bits on the wire of a frame with `length` bytes: the most that stuffing makes of it, with the
// three bits between frames (Bosch CAN 2.0: 34 + 8 n bits can be stuffed, one in four).
[[nodiscard]] constexpr int most_bits(int length) noexcept {
  return 47 + 8 * length + (34 + 8 * length - 1) / 4;
}

}  // namespace drivers::can
