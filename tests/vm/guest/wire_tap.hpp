// What leaves by a network interface, with the kernel's time: every EtherCAT frame that carries the
// wheels' outputs. A socket of its own (AF_PACKET), read by a thread without priority: the kernel
// stamps frames as they pass, however late they are read.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "drivers/ethercat/mapping.hpp"

namespace vm {

struct WireFrame {
  std::int64_t at_ns = 0;  // CLOCK_MONOTONIC
  bool off = false;        // every wheel's five bytes are zero: motor stop
  bool still = false;      // every wheel's setpoint is zero, whatever its mode
};

class WireTap {
 public:
  // Wheels are the slaves 1 to 4, as in a youBot base. Ends the program where it can not listen.
  WireTap(const std::string& iface, const drivers::ethercat::ProcessMapping&);
  ~WireTap();
  WireTap(const WireTap&) = delete;
  WireTap& operator=(const WireTap&) = delete;

  [[nodiscard]] std::size_t count() const noexcept { return count_.load(); }
  [[nodiscard]] const WireFrame& frame(std::size_t i) const { return frames_[i]; }
  // First frame from `at_ns` on; count(): none.
  [[nodiscard]] std::size_t first_from(std::int64_t at_ns) const noexcept;
  // Motor stop, in the newest frame.
  [[nodiscard]] bool off_now() const noexcept;
  [[nodiscard]] std::uint64_t unstamped() const noexcept { return unstamped_.load(); }

 private:
  void listen();
  void take(const std::uint8_t* bytes, std::size_t size, std::int64_t at_ns);

  std::vector<std::size_t> wheel_at_;  // in the image
  int socket_ = -1;
  std::int64_t wall_ahead_ns_ = 0;
  std::vector<WireFrame> frames_;
  std::atomic<std::size_t> count_{0};
  std::atomic<std::uint64_t> unstamped_{0};
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

}  // namespace vm
