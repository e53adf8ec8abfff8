#include "drivers/ethercat/exchange.hpp"

#include <algorithm>

namespace drivers::ethercat {

namespace {

// Frames that are no reply, of one exchange: a babbling neighbour must not hold a cycle.
constexpr int kMostForeign = 64;

}  // namespace

void FrameExchange::begin() noexcept {
  ++index_;
  writer_.clear();
  reply_.fault = FrameFault::kTooShort;
  reply_.count = 0;
}

// A frame that is not of this length is not it; a longer one may be the card's padding.
FrameExchange::Match FrameExchange::match(std::size_t bytes) noexcept {
  parse_frame(std::span(received_).first(std::min(bytes, kMaxFrame)), reply_);
  if (!reply_.good()) return Match::kDamaged;
  if (reply_.datagram[0].index != index_) return Match::kForeign;
  if (reply_.count != sent_.count) return Match::kDamaged;
  for (std::size_t i = 0; i < sent_.count; ++i) {
    const DatagramView &a = sent_.datagram[i], &b = reply_.datagram[i];
    if (a.command != b.command || a.index != b.index || a.data.size() != b.data.size() ||
        b.circulating)
      return Match::kDamaged;
    // Position and broadcast addresses count the slaves; the others stay.
    const bool counts = by_position(a.command) || by_broadcast(a.command);
    if (counts ? a.address >> 16U != b.address >> 16U : a.address != b.address)
      return Match::kDamaged;
  }
  return Match::kReply;
}

bool FrameExchange::send() noexcept {
  const auto bytes = writer_.finish();
  parse_frame(bytes, sent_);
  const rt::Time now = port_.now();
  for (int i = 0; i < kMostForeign && port_.receive(received_, now) > 0; ++i) ++counters_.foreign;
  if (!port_.send(bytes)) {
    ++counters_.refused;
    return false;
  }
  ++counters_.sent;
  return true;
}

bool FrameExchange::collect(rt::Time deadline) noexcept {
  for (int i = 0; i < kMostForeign; ++i) {
    const std::size_t bytes = port_.receive(received_, deadline);
    if (bytes == 0) break;
    const Match m = match(bytes);
    if (m == Match::kReply) return true;
    ++(m == Match::kForeign ? counters_.foreign : counters_.damaged);
  }
  ++counters_.lost;
  reply_.count = 0;
  reply_.fault = FrameFault::kTooShort;
  return false;
}

bool FrameExchange::run(rt::Time deadline) noexcept {
  if (send()) return collect(deadline);
  // A link that is down takes as long as one that is silent: who repeats this does not spin.
  port_.sleep_until(deadline);
  return false;
}

}  // namespace drivers::ethercat
