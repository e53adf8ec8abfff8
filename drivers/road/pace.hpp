// How much may be under way on the images' connection, and how fine they may be: back-off on a
// round trip that grows. A queue in the network shows as round trip above the least one; what is
// under way is cut before the queue is long, so that commands and states that share it stay young.
//
// Every 50 ms: above the least round trip by 40 ms and more: 7 % less; by 25 ms and less, and what
// is allowed was used: 6 % more. Where it stays above, a quality step fewer is wished for, after
// 200 ms and then after each 400 ms; 3 s without it take one step back.
//
// Jitter of a road lifts the smoothed round trip above the kernel's least one without any queue. So
// the least smoothed one counts as the least, once kLooksToKnow looks at a connection in use have
// shown it, and by no more than kJitter above the kernel's.
//
// Until then the smoothed round trip is that of the hand-shake, with late acknowledgements and a
// thread that was busy: no queue. Only what is above by kSurely counts, and nothing is wished for.
//
// Pure: what the kernel says is an argument.
#pragma once

#include <cstddef>

#include "rt/time.hpp"

namespace drivers {

class RoadPace {
 public:
  static constexpr rt::Nanos kPeriod = std::chrono::milliseconds{50};
  static constexpr rt::Nanos kTooLong = std::chrono::milliseconds{40};
  static constexpr rt::Nanos kShort = std::chrono::milliseconds{25};
  static constexpr rt::Nanos kJitter = std::chrono::milliseconds{20};
  static constexpr rt::Nanos kSurely = std::chrono::milliseconds{120};
  static constexpr int kLooksToKnow = 30;
  static constexpr int kMostWish = 5;
  static constexpr std::size_t kLeast = 16384;
  // Of the rate that was set, what images may take: the rest is for the other connection, and for
  // headers. Also the kernel's pace.
  static constexpr double kShare = 0.88;

  // 0: nothing is known of the rate.
  explicit RoadPace(double rate_Mbit_per_s = 0) noexcept;

  // Once each kPeriod. `in_flight`: bytes handed to the kernel that the peer has not acknowledged.
  void look(rt::Nanos round_trip, rt::Nanos least_round_trip, std::size_t in_flight) noexcept;
  // Bytes that may be under way.
  [[nodiscard]] std::size_t allowance() const noexcept { return allowance_; }
  [[nodiscard]] int wish() const noexcept { return wish_; }
  // For the kernel, bytes a second; 0: not paced.
  [[nodiscard]] std::size_t pacing_rate() const noexcept { return pacing_rate_; }

 private:
  std::size_t most_, allowance_, pacing_rate_;
  int wish_ = 0, long_looks_ = 0, calm_looks_ = 0, looks_ = 0;
  rt::Nanos least_smoothed_ = rt::Nanos::max();
};

}  // namespace drivers
