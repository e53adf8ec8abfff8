// EtherCAT on a network card: AF_PACKET, SOCK_RAW, EtherType 0x88A4 (packet(7)). Needs CAP_NET_RAW,
// not root. A socket of that protocol gets no copy of what it sends; should a kernel give one, it
// is left out (PACKET_OUTGOING).
#pragma once

#include <memory>
#include <string>

#include "drivers/ethercat/port.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

class RawPort final : public Port {
 public:
  // The error names the interface and, without the right, CAP_NET_RAW.
  [[nodiscard]] static rt::Result<std::unique_ptr<RawPort>> open(rt::NonRealtime&,
                                                                 const std::string& interface);
  ~RawPort() override;
  RawPort(const RawPort&) = delete;
  RawPort& operator=(const RawPort&) = delete;

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override;
  [[nodiscard]] rt::Time now() const noexcept override;
  void sleep_until(rt::Time) noexcept override;

 private:
  explicit RawPort(int socket) noexcept : socket_(socket) {}
  int socket_;
};

}  // namespace drivers::ethercat
