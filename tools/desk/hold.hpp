// "I still hold this": a key, a button or a pointer that is only as good as the newest token that
// names it. A token lives kLife; after that the hold is lost, and what says it again does not take
// it up: a token without it must come first (the finger is lifted), then a new press.
#pragma once

#include <cstdint>

#include "rt/time.hpp"

namespace teletact {

class Hold {
 public:
  static constexpr rt::Nanos kLife = std::chrono::milliseconds{200};

  // A token came: does it name this hold? `at`: when, box clock.
  void say(bool held, rt::Time at) noexcept {
    expire(at);
    if (!held) {
      state_ = State::kFree;
      return;
    }
    if (state_ == State::kLost) return;
    if (state_ == State::kFree) ++presses_;
    state_ = State::kHeld;
    if (at > said_) said_ = at;
  }
  // Whoever held it is gone.
  void lose() noexcept {
    if (state_ == State::kHeld) state_ = State::kLost;
  }
  // Another page, which holds nothing yet.
  void renew() noexcept { state_ = State::kFree; }

  [[nodiscard]] bool held(rt::Time now) noexcept {
    expire(now);
    return state_ == State::kHeld;
  }
  // It was held, and nobody let it go.
  [[nodiscard]] bool lost() const noexcept { return state_ == State::kLost; }
  [[nodiscard]] bool free() const noexcept { return state_ == State::kFree; }
  [[nodiscard]] rt::Time said() const noexcept { return said_; }  // newest token that named it
  [[nodiscard]] std::uint64_t presses() const noexcept { return presses_; }

 private:
  enum class State : std::uint8_t { kFree, kHeld, kLost };
  void expire(rt::Time now) noexcept {
    if (state_ == State::kHeld && now - said_ > kLife) state_ = State::kLost;
  }
  State state_ = State::kFree;
  rt::Time said_{};
  std::uint64_t presses_ = 0;
};

}  // namespace teletact
