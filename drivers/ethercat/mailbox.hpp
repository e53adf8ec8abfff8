// Mailboxes: the header, and one request with its reply over the registers, a datagram at a time.
// Source: ETG.1000.4, 5.6 (mailbox header), 6.7.4 and ESC data sheet I, 8.3 (mailbox mode, repeat
// request): the master writes the whole out mailbox, waits for the in mailbox to fill, reads the
// whole of it; a reply whose frame was lost is asked for again by the repeat bit.
//
// Raw: the youBot's boards put eight TMCL bytes at byte 0 and no header; the transfer carries any
// bytes and never looks into them.
// Nothing here allocates; a transfer is one owner's.
#pragma once

#include "drivers/ethercat/exchange.hpp"
#include "drivers/ethercat/mapping.hpp"

namespace drivers::ethercat {

// ---- header

inline constexpr std::size_t kMailboxHead = 6;
enum class MailboxType : std::uint8_t {
  kError = 0,
  kAoe = 1,
  kEoe = 2,
  kCoe = 3,
  kFoe = 4,
  kSoe = 5
};

struct MailboxHead {
  std::uint16_t length = 0;  // of what follows the head
  std::uint16_t address = 0;
  std::uint8_t channel_priority = 0;
  MailboxType type = MailboxType::kError;
  std::uint8_t counter = 0;  // 1 to 7; 0: not checked
};
void encode(const MailboxHead&, std::span<std::uint8_t> into) noexcept;
// False: shorter than a head, or its length reaches behind the mailbox.
[[nodiscard]] bool decode(std::span<const std::uint8_t> mailbox, MailboxHead& out) noexcept;
[[nodiscard]] constexpr std::uint8_t next_counter(std::uint8_t c) noexcept {
  return static_cast<std::uint8_t>(c % 7 + 1);
}
// Of an error reply (type 0): its detail, as text.
[[nodiscard]] const char* mailbox_error_text(std::uint16_t detail) noexcept;

// ---- transfer

enum class TransferState : std::uint8_t {
  kIdle,
  kBusy,
  kDone,
  kRefused,  // no mailbox, or the request does not fit
  kNoRoom,   // the out mailbox stayed full
  kNoReply,  // the in mailbox stayed empty; whether the slave acted is not known
};
[[nodiscard]] const char* to_text(TransferState) noexcept;

class MailboxTransfer {
 public:
  // `patience`: datagrams that may bring no progress, in each phase.
  void start(std::uint16_t station, const MailboxPlace& place,
             std::span<const std::uint8_t> request, int patience) noexcept;
  // The same mailbox once more, without a request: the next reply of a longer answer.
  void start_read(std::uint16_t station, const MailboxPlace& place, int patience) noexcept;
  void stop() noexcept { phase_ = Phase::kIdle; }

  [[nodiscard]] TransferState state() const noexcept;
  [[nodiscard]] bool busy() const noexcept { return state() == TransferState::kBusy; }
  // Adds the next datagram. False: nothing to add, or no room in the frame.
  [[nodiscard]] bool add_to(FrameExchange& frame) noexcept;
  // What came of the datagram that was added last.
  void on_reply(const DatagramView& d) noexcept;
  void on_lost() noexcept;

  // The whole in mailbox; valid when kDone.
  [[nodiscard]] std::span<const std::uint8_t> reply() const noexcept {
    return std::span(reply_).first(place_.in_length);
  }
  // Replies that lay in the mailbox from before and were thrown away.
  [[nodiscard]] std::uint64_t stale() const noexcept { return stale_; }
  [[nodiscard]] std::uint64_t repeats() const noexcept { return repeats_; }

 private:
  enum class Phase : std::uint8_t {
    kIdle,
    kLook,        // does an old reply lie there?
    kThrowAway,   // read it
    kRoom,        // is the out mailbox empty?
    kWrite,       //
    kPoll,        // has the reply come?
    kRead,        //
    kRepeatLook,  // a read was lost: state of the repeat bits
    kRepeatAsk,   // turn the bit
    kRepeatWait,  // until the slave has turned its own
    kDone,
    kRefused,
    kNoRoom,
    kNoReply
  };
  void go(Phase next) noexcept;
  void wait(Phase failure) noexcept;
  [[nodiscard]] bool spend() noexcept;
  void on_repeat(const DatagramView& d) noexcept;

  std::uint16_t station_ = 0;
  MailboxPlace place_;
  std::array<std::uint8_t, kMostMailbox> request_{}, reply_{};
  Phase phase_ = Phase::kIdle;
  int patience_ = 0, waited_ = 0, budget_ = 0;
  std::uint8_t repeat_bit_ = 0;
  std::uint64_t stale_ = 0, repeats_ = 0;
};

}  // namespace drivers::ethercat
