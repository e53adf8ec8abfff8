// When the console's address is to be printed again, with a new code: the operator's browser has
// been closed, and its session with it, or nobody has come before the code ended. Pure.
#pragma once

#include <chrono>
#include <cstdint>

namespace teletact {

class CodeOffer {
 public:
  // A reload or a short gap of the network is no leaving.
  static constexpr std::int64_t kGone_ns = 15'000'000'000;
  // Before a code that nobody used ends (ConsoleOptions::code_life, an hour).
  static constexpr std::int64_t kOld_ns = 50LL * 60 * 1'000'000'000;

  explicit CodeOffer(std::int64_t now_ns) noexcept : offered_ns_(now_ns), seen_ns_(now_ns) {}

  // `there`: an operator's page is connected. True: offer a new code now.
  [[nodiscard]] bool due(bool there, std::int64_t now_ns) noexcept {
    if (there) {
      used_ = true;
      seen_ns_ = now_ns;
      return false;
    }
    const bool gone = used_ && now_ns - seen_ns_ >= kGone_ns;
    if (!gone && now_ns - (used_ ? seen_ns_ : offered_ns_) < kOld_ns) return false;
    used_ = false;
    offered_ns_ = seen_ns_ = now_ns;
    return true;
  }

 private:
  std::int64_t offered_ns_, seen_ns_;
  bool used_ = false;
};

}  // namespace teletact
