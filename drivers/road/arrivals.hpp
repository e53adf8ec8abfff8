// Strangers before the door: whose TLS handshake begins next, and who goes when there are too many.
//
// A handshake costs about a millisecond of CPU before its peer is known, so they begin at a rate.
// Connecting costs next to nothing, so all are taken from the kernel at once and wait here. Turns
// go round by place (an address; of IPv6 its /64): a crowd from one place holds up nobody from
// another by more than a turn. Places that had a session have turns of their own beside that.
//
// Pure: time and places are arguments.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace drivers {

// How many may be in the handshake, and wait for theirs; of the latter how many from one place.
inline constexpr std::size_t kMostArrivals = 16, kMostWaiting = 64, kMostWaitingOfOne = 8;

// So many a second may begin, so many at once.
class ArrivalRate {
 public:
  ArrivalRate(double per_s, double at_once) noexcept
      : per_s_(per_s), at_once_(at_once), left_(at_once) {}
  [[nodiscard]] bool ready(std::int64_t now_ns) noexcept;      // one may begin
  [[nodiscard]] bool may_begin(std::int64_t now_ns) noexcept;  // and it does

 private:
  double per_s_, at_once_, left_;
  std::int64_t last_ns_ = 0;
  bool begun_ = false;
};

// "10.0.0.3"; of "2001:db8:1:2::7" "2001:db8:1:2::/64"; of "::ffff:10.0.0.3" the IPv4 address.
[[nodiscard]] std::string place_of(std::string_view address);

class ArrivalTurns {
 public:
  static constexpr double kPerSecond = 20, kAtOnce = 20;
  static constexpr double kKnownPerSecond = 5, kKnownAtOnce = 10;
  static constexpr std::size_t kMostKnown = 8, kMostServed = 256;

  // Which of those that wait, oldest first, begins now; none: nobody waits, or not yet.
  [[nodiscard]] std::optional<std::size_t> next(std::span<const std::string> places,
                                                std::int64_t now_ns);
  // Which one is to go: the oldest of the place that has the most. A place that had a session goes
  // only where all are such. `places` is not empty; oldest first.
  [[nodiscard]] std::size_t to_drop(std::span<const std::string> places) const;
  void had_session(const std::string& place);

 private:
  struct Served {
    std::string place;
    std::uint64_t turn;
  };
  [[nodiscard]] bool known(const std::string& place) const;
  [[nodiscard]] std::uint64_t last_turn(const std::string& place) const;
  void serve(const std::string& place);

  ArrivalRate strangers_{kPerSecond, kAtOnce}, of_known_{kKnownPerSecond, kKnownAtOnce};
  std::vector<std::string> known_;  // newest last
  std::vector<Served> served_;      // newest last
  std::uint64_t turn_ = 0;
};

}  // namespace drivers
