// Between the kernel's frames and ours: pure functions, so that they can be tested without a bus.
#pragma once

#include <linux/can.h>
#include <sys/socket.h>

#include <cstdint>

#include "drivers/can/can_frame.hpp"
#include "drivers/can/can_port.hpp"

namespace drivers::can {

[[nodiscard]] can_frame to_kernel(const CanFrame&) noexcept;

enum class FrameKind : std::uint8_t { kData, kError, kOther };
// Of `bytes` bytes as read from the socket; kOther: flexible rate, too short, or a length that a
// classic frame can not have. `out` is set for kData alone.
[[nodiscard]] FrameKind from_kernel(const can_frame&, std::size_t bytes, CanFrame& out) noexcept;

// What an error frame does to state and counters.
struct BusWatch {
  PortState port = PortState::kUp;
  BusState bus = BusState::kActive;
  PortCounters counters;
  void take_error(std::uint32_t id, std::span<const std::uint8_t, 8> data) noexcept;
  // A frame passed: interface and controller work.
  void take_life() noexcept;
  // The queue took all: it is not full, and the interface is up.
  void take_room() noexcept;
  // errno of a send or receive that failed.
  void take_errno(int error) noexcept;
};

// Kernel's software time and dropped frames of a message's control data; false: no time in it.
[[nodiscard]] bool read_control(const msghdr& head, std::int64_t& realtime_ns,
                                std::uint32_t& dropped_so_far) noexcept;

}  // namespace drivers::can
