// Where CAN frames go and come from: a socket, or the twin's bus. One owner's thread, but for
// send_at_once().
#pragma once

#include <cstdint>
#include <span>

#include "drivers/can/can_frame.hpp"

namespace drivers::can {

struct Received {
  CanFrame frame;
  rt::Time at{};  // the kernel's time of its arrival, as the caller's clock
};

enum class PortState : std::uint8_t {
  kUp,
  kQueueFull,  // the last send did not take all: nobody acknowledges, or the bus is overloaded
  kBusOff,     // the controller has switched itself off
  kDown,       // the interface is down
  kGone        // there is no such interface any more
};
[[nodiscard]] const char* to_text(PortState) noexcept;

struct PortCounters {
  std::uint64_t sent = 0, received = 0;
  std::uint64_t refused = 0;  // not sent: queue full
  std::uint64_t dropped = 0;  // received by the kernel, and lost before this program read them
  std::uint64_t error_frames = 0, bus_offs = 0, restarts = 0, no_acks = 0, overflows = 0,
                protocol_errors = 0;
  std::uint64_t not_classic = 0;  // extended, remote or flexible-rate frames: passed over
};

class CanPort {
 public:
  virtual ~CanPort() = default;
  // Sends in this order. Returns how many were taken; the rest was not sent and is not kept.
  [[nodiscard]] virtual int send(rt::Time now, std::span<const CanFrame>) noexcept = 0;
  // What has arrived, oldest first. Never waits. Error frames are not among them: state().
  [[nodiscard]] virtual int receive(rt::Time now, std::span<Received>) noexcept = 0;
  // From any thread, even while the owner hangs.
  virtual void send_at_once(std::span<const CanFrame>) noexcept = 0;
  [[nodiscard]] virtual PortState state() const noexcept = 0;
  [[nodiscard]] virtual BusState bus_state() const noexcept = 0;
  [[nodiscard]] virtual const PortCounters& counters() const noexcept = 0;
};

}  // namespace drivers::can
