// What a road asks of the kernel for its TCP connections, and what the kernel says of them. Linux.
#pragma once

#include <cstddef>
#include <string>

#include "rt/time.hpp"

namespace drivers {

// Newest wins: little waits in the kernel unsent (control 4 kB, bulk 16 kB), nothing is collected
// (TCP_NODELAY), images are paced (bytes a second; 0: not), BBR where the kernel has it, since
// cubic can not hold a long road with any loss. The size of the send buffer stays the kernel's:
// smaller than rate x round trip it would throttle a long road. What the kernel refuses is left
// out.
void set_up_road_socket(int fd, bool bulk, std::size_t pacing_rate) noexcept;
// BBR asks for a round trip as short as its shortest once in 10 s, and where jitter gives it none,
// it sends next to nothing for a third of a second: states and pictures stop. Begun anew before
// that, it never does; that the queue stays short is our own pace's work (pace.hpp). For a socket
// whose round trip is short now. Nothing happens while packets are lost, or without BBR.
void begin_congestion_anew(int fd) noexcept;
// Read back; "?": the kernel does not say.
[[nodiscard]] std::string congestion_of(int fd);

struct RoadSocketState {
  rt::Nanos round_trip{0}, least_round_trip{0};
  double delivered_bytes_per_s = 0;
};
[[nodiscard]] RoadSocketState state_of(int fd) noexcept;
// Bytes handed over that the peer has not acknowledged.
[[nodiscard]] std::size_t in_flight_of(int fd) noexcept;

}  // namespace drivers
