// A tun device in a network namespace: packets of one host's end of the road. Needs root, and
// /dev/net/tun.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "rt/result.hpp"

namespace teletact {

// Which congestion controls a socket of this kernel takes, of `names`: set and read back.
[[nodiscard]] std::vector<std::string> settable_congestion(const std::vector<std::string>& names);

// Why no device can be made here, in one line; empty: it can.
[[nodiscard]] std::string road_refusal();

class TunDevice {
 public:
  // Makes `name` with the address in the namespace (as of `ip netns add`), and brings it up, with a
  // packet of at most 1500 bytes and without IPv6, whose own packets nobody asked for. The device
  // ends with this object.
  [[nodiscard]] static rt::Result<TunDevice> open(const std::string& ns, const std::string& name,
                                                  const std::string& address, int prefix);
  TunDevice(TunDevice&& o) noexcept : fd_(o.fd_), buffer_(std::move(o.buffer_)) { o.fd_ = -1; }
  TunDevice& operator=(TunDevice&&) = delete;
  TunDevice(const TunDevice&) = delete;
  TunDevice& operator=(const TunDevice&) = delete;
  ~TunDevice();

  [[nodiscard]] int fd() const noexcept { return fd_; }
  // A whole packet of the host behind it; empty: none waits.
  [[nodiscard]] std::span<const std::uint8_t> read();
  // To that host. False: not taken.
  [[nodiscard]] bool write(std::span<const std::uint8_t> packet);

 private:
  explicit TunDevice(int fd) : fd_(fd), buffer_(2048) {}
  int fd_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace teletact
