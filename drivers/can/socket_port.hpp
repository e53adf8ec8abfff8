// A CAN port on a raw SocketCAN socket of one interface. Opening throws; what a job calls waits for
// nothing and allocates nothing: one recvmmsg until it returns less than asked, one sendmmsg.
//
//   filter        the reply identifiers, standard data frames alone; and error frames of a chosen
//                 set (controller state, no acknowledge, bus-off, restarted, counters)
//   queue full    ENOBUFS or EAGAIN: not sent, counted, not kept. A frame that waits would be a
//                 stale command; keep txqueuelen near the frames of one cycle
//   bus-off       kBusOff until the controller restarts (`ip link set can0 type can restart`, or
//                 restart-ms); the socket stays
//   down          ENETDOWN: kDown until frames pass again; no need to open it anew
//   time stamps   the kernel's (SO_TIMESTAMPING, software), wall clock, brought to the caller's
//
// Needs no right but an interface that is up; `teletact doctor` says what to do.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/can/can_port.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::can {

struct SocketOptions {
  std::string iface = "can0";
  std::vector<std::uint32_t> receive;  // identifiers; empty: all standard data frames
  int receive_buffer_bytes = 1 << 18;
};

// Throws std::runtime_error with one line that says what to do.
[[nodiscard]] std::unique_ptr<CanPort> open_socket_port(rt::NonRealtime&, const SocketOptions&);

}  // namespace drivers::can
