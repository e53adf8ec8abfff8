// Who may come in: one peer at a time, with two connections that belong together.
//
// The first connection (control) is promised the place and gets a token; the second (bulk) must
// bring it within kTokenLife, with the same certificate. A token is good once. Whoever else asks
// meanwhile is refused with a reason that it can read.
//
// One peer of the lab can not keep another one out by asking alone:
//   - a promise is firm for kFirm; then it goes to whoever else asks;
//   - who did not keep a promise is refused for kSitOut, where somebody else has asked in that
//     time;
//   - a steady session that was cut leaves its peer the first word for kFirstWord, so that a flap
//     of the road gives the place to nobody else.
//
// Pure: time, names and random bytes are arguments.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/road/road_frame.hpp"
#include "drivers/road/road_options.hpp"

namespace drivers {

class RoadDoor {
 public:
  static constexpr rt::Nanos kTokenLife = std::chrono::seconds{5};
  static constexpr rt::Nanos kFirm = std::chrono::seconds{1};
  static constexpr rt::Nanos kSitOut = std::chrono::seconds{5};
  static constexpr rt::Nanos kFirstWord = std::chrono::seconds{5};
  static constexpr std::size_t kMostRemembered = 16;

  explicit RoadDoor(rt::Box role) noexcept : role_(role) {}

  // Empty: the place is promised, and `fresh` is the token to send. Else why not. Where it takes
  // the place of a promise that was not kept, displaced() says so until the next call.
  [[nodiscard]] std::string ask_control(const RoadPeer& peer, std::int64_t now_ns,
                                        const RoadToken& fresh);
  [[nodiscard]] bool displaced() const noexcept { return displaced_; }
  // Empty: the session stands. Else why not.
  [[nodiscard]] std::string ask_bulk(const RoadPeer& peer, std::int64_t now_ns,
                                     const RoadToken& token);
  // The promise has run out: the control connection must be closed, and leave() called.
  [[nodiscard]] bool overdue(std::int64_t now_ns) const noexcept {
    return state_ == State::kPromised && now_ns > until_ns_;
  }
  // The session, or the promise, is over.
  enum class End : std::uint8_t {
    kOver,      // an orderly end, or a fault of the peer's own
    kCut,       // of a session: no word of the peer came first
    kForgotten  // of a promise, because of the certificate or of this box itself
  };
  void leave(std::int64_t now_ns, End end) noexcept;
  [[nodiscard]] bool taken() const noexcept { return state_ == State::kTaken; }

 private:
  enum class State : std::uint8_t { kFree, kPromised, kTaken };
  struct Unkept {
    std::string key;
    std::int64_t until_ns;
  };
  struct Asked {
    std::string key;
    std::int64_t at_ns;
  };
  [[nodiscard]] std::string busy() const;
  [[nodiscard]] bool another_waits(const RoadPeer& peer, std::int64_t now_ns) const noexcept;
  [[nodiscard]] std::string judge(const RoadPeer& peer, std::int64_t now_ns);

  rt::Box role_;
  State state_ = State::kFree;
  RoadPeer peer_;
  RoadToken token_{};
  std::int64_t firm_until_ns_ = 0, until_ns_ = 0;
  std::vector<Unkept> unkept_;  // newest last
  std::vector<Asked> asked_;    // who was refused, and when last; newest last
  RoadPeer first_word_;
  std::int64_t first_word_until_ns_ = 0;
  bool displaced_ = false;
};

}  // namespace drivers
