// Who may come in: one peer at a time, with two connections that belong together.
//
// The first connection (control) is promised the place and gets a token; the second (bulk) must
// bring it within `token_life`, with the same certificate. A token is good once. Whoever else asks
// meanwhile is refused with a reason that it can read.
//
// Pure: time, names and random bytes are arguments.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/road/road_frame.hpp"
#include "drivers/road/road_options.hpp"

namespace drivers {

class RoadDoor {
 public:
  static constexpr rt::Nanos kTokenLife = std::chrono::seconds{5};

  explicit RoadDoor(rt::Box role) noexcept : role_(role) {}

  // Empty: the place is promised, and `fresh` is the token to send. Else why not.
  [[nodiscard]] std::string ask_control(const RoadPeer& peer, std::int64_t now_ns,
                                        const RoadToken& fresh);
  // Empty: the session stands. Else why not.
  [[nodiscard]] std::string ask_bulk(const RoadPeer& peer, std::int64_t now_ns,
                                     const RoadToken& token);
  // The promise has run out: the control connection must be closed, and leave() called.
  [[nodiscard]] bool overdue(std::int64_t now_ns) const noexcept {
    return state_ == State::kPromised && now_ns > until_ns_;
  }
  // The session, or the promise, is over.
  void leave() noexcept;
  [[nodiscard]] bool taken() const noexcept { return state_ == State::kTaken; }

 private:
  enum class State : std::uint8_t { kFree, kPromised, kTaken };
  rt::Box role_;
  State state_ = State::kFree;
  RoadPeer peer_;
  RoadToken token_{};
  std::int64_t until_ns_ = 0;
};

// How many strangers may stand before the door, in the handshake.
inline constexpr std::size_t kMostArrivals = 16;
// One more has come and there is no room: the place of the one to drop, the oldest of the address
// that has the most. So a crowd from one place can not keep others out. `addresses`: oldest first.
[[nodiscard]] std::size_t arrival_to_drop(std::span<const std::string> addresses) noexcept;

// Handshakes cost CPU: 20 a second may begin, 20 at once; the kernel lets the others wait.
class ArrivalRate {
 public:
  static constexpr double kPerSecond = 20, kAtOnce = 20;
  [[nodiscard]] bool may_begin(std::int64_t now_ns) noexcept;

 private:
  double left_ = kAtOnce;
  std::int64_t last_ns_ = 0;
  bool begun_ = false;
};

}  // namespace drivers
