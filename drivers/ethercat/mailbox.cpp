#include "drivers/ethercat/mailbox.hpp"

#include <algorithm>

#include "drivers/ethercat/registers.hpp"

namespace drivers::ethercat {

void encode(const MailboxHead& h, std::span<std::uint8_t> into) noexcept {
  store_u16(into, 0, h.length);
  store_u16(into, 2, h.address);
  into[4] = h.channel_priority;
  into[5] = static_cast<std::uint8_t>((static_cast<unsigned>(h.type) & 0x0FU) | (h.counter & 0x07U)
                                                                                    << 4U);
}

bool decode(std::span<const std::uint8_t> mailbox, MailboxHead& out) noexcept {
  if (mailbox.size() < kMailboxHead) return false;
  const std::uint16_t length = load_u16(mailbox);
  if (length > mailbox.size() - kMailboxHead) return false;
  out.length = length;
  out.address = load_u16(mailbox, 2);
  out.channel_priority = mailbox[4];
  out.type = static_cast<MailboxType>(mailbox[5] & 0x0FU);
  out.counter = mailbox[5] >> 4U & 0x07U;
  return true;
}

const char* mailbox_error_text(std::uint16_t detail) noexcept {
  static constexpr std::array kTexts{"unknown mailbox error",  "syntax of the head is wrong",
                                     "protocol not supported", "wrong channel",
                                     "service not supported",  "invalid head",
                                     "data too short",         "no memory",
                                     "size does not agree"};
  return kTexts[detail < kTexts.size() ? detail : 0];
}

const char* to_text(TransferState s) noexcept {
  static constexpr std::array kTexts{"idle",
                                     "busy",
                                     "done",
                                     "the slave has no mailbox, or the request does not fit",
                                     "the slave's mailbox stayed full",
                                     "no reply"};
  return kTexts[static_cast<std::size_t>(s)];
}

void MailboxTransfer::start(std::uint16_t station, const MailboxPlace& place,
                            std::span<const std::uint8_t> request, int patience) noexcept {
  start_read(station, place, patience);
  if (phase_ == Phase::kRefused) return;
  if (request.size() > place.out_length) {
    phase_ = Phase::kRefused;
    return;
  }
  const auto end = std::copy(request.begin(), request.end(), request_.begin());
  std::fill(end, request_.begin() + place.out_length, std::uint8_t{0});
  phase_ = Phase::kLook;
}

void MailboxTransfer::start_read(std::uint16_t station, const MailboxPlace& place,
                                 int patience) noexcept {
  station_ = station;
  place_ = place;
  patience_ = patience;
  budget_ = 8 * patience;
  waited_ = 0;
  const bool fits =
      place.usable() && place.out_length <= kMostMailbox && place.in_length <= kMostMailbox;
  phase_ = fits ? Phase::kPoll : Phase::kRefused;
  if (!fits) place_ = {};
}

TransferState MailboxTransfer::state() const noexcept {
  switch (phase_) {
    case Phase::kIdle:
      return TransferState::kIdle;
    case Phase::kDone:
      return TransferState::kDone;
    case Phase::kRefused:
      return TransferState::kRefused;
    case Phase::kNoRoom:
      return TransferState::kNoRoom;
    case Phase::kNoReply:
      return TransferState::kNoReply;
    default:
      return TransferState::kBusy;
  }
}

bool MailboxTransfer::add_to(FrameExchange& frame) noexcept {
  const auto at = [&](std::uint16_t r) { return station_address(station_, r); };
  switch (phase_) {
    case Phase::kLook:
    case Phase::kPoll:
      return frame.add(Command::kFprd, at(reg::sm_status(1)), 1);
    case Phase::kThrowAway:
    case Phase::kRead:
      return frame.add(Command::kFprd, at(place_.in_start), place_.in_length);
    case Phase::kRoom:
      return frame.add(Command::kFprd, at(reg::sm_status(0)), 1);
    case Phase::kWrite:
      return frame.add(Command::kFpwr, at(place_.out_start), place_.out_length,
                       std::span(request_).first(place_.out_length));
    case Phase::kRepeatLook:
    case Phase::kRepeatWait:
      return frame.add(Command::kFprd, at(reg::sm_activate(1)), 2);
    case Phase::kRepeatAsk: {
      const std::array<std::uint8_t, 1> b{static_cast<std::uint8_t>(sm::kEnable | repeat_bit_)};
      return frame.add(Command::kFpwr, at(reg::sm_activate(1)), 1, b);
    }
    default:
      return false;
  }
}

void MailboxTransfer::go(Phase next) noexcept {
  phase_ = next;
  waited_ = 0;
}

void MailboxTransfer::wait(Phase failure) noexcept {
  if (++waited_ >= patience_) go(failure);
}

// No phase waits for ever, and no circle of phases either.
bool MailboxTransfer::spend() noexcept {
  if (--budget_ > 0) return true;
  const bool before = phase_ == Phase::kLook || phase_ == Phase::kThrowAway ||
                      phase_ == Phase::kRoom || phase_ == Phase::kWrite;
  go(before ? Phase::kNoRoom : Phase::kNoReply);
  return false;
}

// Register 0x080E and 0x080F: the request bit, and the slave's acknowledge, which follows it.
void MailboxTransfer::on_repeat(const DatagramView& d) noexcept {
  if (phase_ == Phase::kRepeatAsk) {
    go(Phase::kRepeatWait);
  } else if (phase_ == Phase::kRepeatLook) {
    repeat_bit_ = (d.data[0] ^ sm::kRepeatRequest) & sm::kRepeatRequest;
    ++repeats_;
    go(Phase::kRepeatAsk);
  } else if ((d.data[1] & sm::kRepeatAck) == repeat_bit_) {
    go(Phase::kPoll);
  } else {
    wait(Phase::kNoReply);
  }
}

void MailboxTransfer::on_reply(const DatagramView& d) noexcept {
  if (!busy() || !spend()) return;
  const bool took = d.counter == 1;
  switch (phase_) {
    case Phase::kLook:
      if (took && (d.data[0] & sm::kFull) == 0) return go(Phase::kRoom);
      return took ? go(Phase::kThrowAway) : wait(Phase::kNoRoom);
    case Phase::kThrowAway:
      stale_ += took ? 1 : 0;
      return go(Phase::kLook);
    case Phase::kRoom:
      if (took && (d.data[0] & sm::kFull) == 0) return go(Phase::kWrite);
      return wait(Phase::kNoRoom);
    case Phase::kWrite:  // counter 0: it filled in between, which is flow control and no error
      return took ? go(Phase::kPoll) : go(Phase::kRoom);
    case Phase::kPoll:
      if (took && (d.data[0] & sm::kFull) != 0) return go(Phase::kRead);
      return wait(Phase::kNoReply);
    case Phase::kRead:
      if (!took) return go(Phase::kPoll);
      std::copy(d.data.begin(), d.data.end(), reply_.begin());
      return go(Phase::kDone);
    case Phase::kRepeatLook:
    case Phase::kRepeatAsk:
    case Phase::kRepeatWait:
      return took ? on_repeat(d) : wait(Phase::kNoReply);
    default:
      return;
  }
}

// A lost write may have arrived: it is never written twice, the reply tells. A lost read may have
// emptied the mailbox: the slave is asked to put the reply there again.
void MailboxTransfer::on_lost() noexcept {
  if (!busy() || !spend()) return;
  if (phase_ == Phase::kWrite) return go(Phase::kPoll);
  if (phase_ == Phase::kRead) return go(Phase::kRepeatLook);
  if (phase_ == Phase::kThrowAway) return go(Phase::kLook);
  // All others may be sent again as they are: the repeat bit too, since its new value is written.
  wait(phase_ == Phase::kLook || phase_ == Phase::kRoom ? Phase::kNoRoom : Phase::kNoReply);
}

}  // namespace drivers::ethercat
