// Time, as the whole stack speaks it.
//
//   Nanos   a duration, integer nanoseconds (std::chrono)
//   Time    an instant of *this box's* clock; the only form tasks, devices and executors handle
//   Stamp   an instant of a *named* box's clock; what crosses the link. Only drivers/link turns a
//           Stamp of another box into a Time, by the measured clock offset.
//   Rate    an exact fraction of hertz: 30 Hz is {30, 1}. Release k is an integer formula, so
//           1000/30/10 Hz share an exact 100 ms hyperperiod and nothing drifts.
#pragma once

#include <chrono>
#include <cstdint>
#include <numeric>

namespace rt {

using Nanos = std::chrono::nanoseconds;

// Tag for std::chrono: the clock of the box that this process is.
struct BoxClock {
  using duration = Nanos;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<BoxClock, duration>;
  static constexpr bool is_steady = true;
};
using Time = BoxClock::time_point;

enum class Box : std::uint8_t { kOperator = 0, kRobot = 1 };

struct Stamp {
  Box box = Box::kOperator;
  std::int64_t ns = 0;
  friend bool operator==(const Stamp&, const Stamp&) = default;
};

[[nodiscard]] constexpr Stamp to_stamp(Time t, Box box) noexcept {
  return {box, t.time_since_epoch().count()};
}
[[nodiscard]] constexpr Time time_from_ns(std::int64_t ns) noexcept { return Time{Nanos{ns}}; }
[[nodiscard]] constexpr std::int64_t ns_of(Time t) noexcept { return t.time_since_epoch().count(); }
[[nodiscard]] constexpr double seconds(Nanos d) noexcept {
  return static_cast<double>(d.count()) * 1e-9;
}
[[nodiscard]] constexpr Nanos nanos_from_seconds(double s) noexcept {
  return Nanos{static_cast<std::int64_t>(s * 1e9 + (s >= 0 ? 0.5 : -0.5))};
}

struct Rate {
  std::int64_t num = 1;  // jobs ...
  std::int64_t den = 1;  // ... per this many seconds

  [[nodiscard]] constexpr Rate reduced() const noexcept {
    const auto g = std::gcd(num, den);
    return {num / g, den / g};
  }
  // Instant of release k after the epoch: floor(k * 1e9 * den / num), exact for any k >= 0.
  [[nodiscard]] constexpr Nanos release(std::uint64_t k) const noexcept {
    __extension__ using Wide = unsigned __int128;
    return Nanos{static_cast<std::int64_t>(static_cast<Wide>(k) * 1000000000ULL *
                                           static_cast<std::uint64_t>(den) /
                                           static_cast<std::uint64_t>(num))};
  }
  // Longest distance between two releases, rounded up: a lower-rate-first order never ties wrongly.
  [[nodiscard]] constexpr Nanos period() const noexcept {
    return Nanos{(1000000000LL * den + num - 1) / num};
  }
  [[nodiscard]] constexpr double hz() const noexcept {
    return static_cast<double>(num) / static_cast<double>(den);
  }
  friend constexpr bool operator==(const Rate&, const Rate&) = default;
};

}  // namespace rt
