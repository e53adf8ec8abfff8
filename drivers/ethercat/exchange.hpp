// One frame out and the same frame back. The index byte of its datagrams is the frame's number,
// which slaves do not change (ESC data sheet I, 2.4): it tells the reply from late, doubled and
// foreign frames, which are counted and left.
//
// Nothing here allocates; one owner.
#pragma once

#include <cstdint>

#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/port.hpp"

namespace drivers::ethercat {

struct ExchangeCounters {
  std::uint64_t sent = 0;
  std::uint64_t refused = 0;  // not sent: the port took no frame, so the link is down
  std::uint64_t lost = 0;     // sent, and not back in time
  std::uint64_t foreign = 0;  // came, but is no reply to this frame: late, twice, or another's
  std::uint64_t damaged = 0;  // came and is no EtherCAT frame, or not the one that was sent
};

class FrameExchange {
 public:
  explicit FrameExchange(Port& port) noexcept : port_(port) {}

  // A new frame: the old one and its reply are gone.
  void begin() noexcept;
  [[nodiscard]] bool add(Command command, std::uint32_t address, std::size_t length,
                         std::span<const std::uint8_t> data = {}) noexcept {
    return writer_.add(command, index_, address, length, data);
  }
  [[nodiscard]] std::size_t count() const noexcept { return writer_.count(); }

  // Sends, and waits for the reply until then. True: it is in reply(). Frames that wait from
  // earlier are read away first.
  [[nodiscard]] bool run(rt::Time deadline) noexcept;
  // In two parts, for a caller with work in between.
  [[nodiscard]] bool send() noexcept;
  [[nodiscard]] bool collect(rt::Time deadline) noexcept;

  // Of the last run() that was true: as many datagrams as were added, in their order.
  [[nodiscard]] const FrameView& reply() const noexcept { return reply_; }
  [[nodiscard]] const DatagramView& reply(std::size_t i) const noexcept {
    return reply_.datagram[i];
  }
  [[nodiscard]] const ExchangeCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] Port& port() noexcept { return port_; }

 private:
  enum class Match : std::uint8_t { kReply, kForeign, kDamaged };
  [[nodiscard]] Match match(std::size_t bytes) noexcept;

  Port& port_;
  FrameWriter writer_;
  FrameView sent_, reply_;
  std::array<std::uint8_t, kMaxFrame + 4> received_{};  // a card may leave the check sequence
  ExchangeCounters counters_;
  std::uint8_t index_ = 0;
};

}  // namespace drivers::ethercat
