// How many bytes of large views may be on their way to a page that says what it has seen: what its
// line holds while one goes there and the word of it comes back, and one view more. What is beyond
// that would only wait where nothing newer can replace it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>

namespace teletact {

class BulkWindow {
 public:
  static constexpr std::uint64_t kLeastBytes = std::uint64_t{256} << 10U;
  static constexpr std::uint64_t kMostBytes = std::uint64_t{4} << 20U;

  // Before the first word from the page there is always room.
  [[nodiscard]] bool room() const noexcept { return !tells_ || unseen() < limit(); }
  [[nodiscard]] std::uint64_t unseen() const noexcept { return sent_ - seen_; }

  void sent(std::uint64_t bytes, std::int64_t now_ns) {
    const bool alone = unseen() == 0;
    sent_ += bytes;
    ways_.push_back({sent_, seen_, now_ns, alone});
    if (ways_.size() > kMostWays) ways_.pop_front();  // of a page that never says it
  }

  // `bytes`: of all since the connection stands. False: more than was sent, or less than before.
  [[nodiscard]] bool seen(std::uint64_t bytes, std::int64_t now_ns) {
    if (bytes < seen_ || bytes > sent_) return false;
    seen_ = bytes;
    tells_ = true;
    while (!ways_.empty() && ways_.front().end <= bytes) {
      const Way way = ways_.front();
      ways_.pop_front();
      const std::int64_t took_ns = std::max<std::int64_t>(now_ns - way.at_ns, 1000);
      if (way.alone || shortest_ns_ != kUnknown) shortest_ns_ = std::min(shortest_ns_, took_ns);
      const double rate = static_cast<double>(bytes - way.seen_then) / static_cast<double>(took_ns);
      rate_ = std::max(rate, kForget * rate_);
    }
    if (now_ns - lap_ns_ > kLap_ns) {  // the line may have become another one
      shortest_ns_ = kUnknown;
      lap_ns_ = now_ns;
    }
    return true;
  }

 private:
  struct Way {
    std::uint64_t end = 0, seen_then = 0;  // bytes: up to its last one; seen when it left
    std::int64_t at_ns = 0;
    bool alone = false;  // nothing else was on its way: it waited for none
  };
  static constexpr std::size_t kMostWays = 1024;
  static constexpr std::int64_t kLap_ns = 30'000'000'000;
  static constexpr std::int64_t kUnknown = std::int64_t{1} << 62U;
  static constexpr double kMore = 1.25;    // of what the line held: so that it is tried for more
  static constexpr double kForget = 0.95;  // of the best rate, each view

  [[nodiscard]] std::uint64_t limit() const noexcept {
    if (shortest_ns_ == kUnknown) return 1;  // one alone, which tells
    const double held = kMore * rate_ * static_cast<double>(shortest_ns_);
    return std::clamp(static_cast<std::uint64_t>(std::min(held, 1e12)), kLeastBytes, kMostBytes);
  }

  std::uint64_t sent_ = 0, seen_ = 0;
  bool tells_ = false;
  std::deque<Way> ways_;
  std::int64_t shortest_ns_ = kUnknown, lap_ns_ = 0;
  double rate_ = 0;  // bytes a ns
};

}  // namespace teletact
