// EtherCAT on a network card: AF_PACKET, SOCK_RAW, EtherType 0x88A4 (packet(7)). Needs CAP_NET_RAW,
// not root. A socket of that protocol gets no copy of what it sends; should a kernel give one, it
// is left out (PACKET_OUTGOING).
//
// A pulled cable shows in no call of the socket: the card is up, and the kernel drops the frame and
// says that it was sent. IFF_RUNNING (netdevice(7)) tells, by SIOCGIFFLAGS, which the kernel
// answers without a lock that another process could hold: 0.6 us. It follows the carrier within
// milliseconds; of a link that comes and goes more than once a second, within a second.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "drivers/ethercat/port.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

class RawPort final : public Port {
 public:
  // The error names the interface and, without the right, CAP_NET_RAW; of a card that is down, the
  // command that sets it up.
  [[nodiscard]] static rt::Result<std::unique_ptr<RawPort>> open(rt::NonRealtime&,
                                                                 const std::string& interface);
  ~RawPort() override;
  RawPort(const RawPort&) = delete;
  RawPort& operator=(const RawPort&) = delete;

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override;
  [[nodiscard]] bool link_up() noexcept override;
  [[nodiscard]] rt::Time now() const noexcept override;
  void sleep_until(rt::Time) noexcept override;

 private:
  RawPort(int socket, const std::string& interface) noexcept;
  int socket_;
  bool gone_ = false;  // the last frame was refused by an interface that is down, or not there
  std::array<char, 16> interface_{};  // IFNAMSIZ; empty: it can not be asked
};

}  // namespace drivers::ethercat
