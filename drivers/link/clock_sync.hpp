// Offset between the two boxes' clocks by four-timestamp exchange; the samples with the smallest
// round trip count, since queueing only ever adds. remote = local + offset.
//
// Uncertainty: half the round trip of the sample in use (its asymmetry is not observable), plus
// what a drift of 200 ppm adds since it was taken.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "rt/time.hpp"

namespace drivers {

class ClockSync {
 public:
  static constexpr int kWindow = 16;
  static constexpr double kDriftBound = 200e-6;

  // t0 local send, t1 remote receive, t2 remote send, t3 local receive. Implausible sets (negative
  // round trip, over 10 s) are refused.
  bool add(std::int64_t t0, std::int64_t t1, std::int64_t t2, std::int64_t t3) noexcept {
    const std::int64_t rtt = (t3 - t0) - (t2 - t1);
    if (t2 < t1 || rtt < 0 || rtt > 10'000'000'000) return false;
    samples_[static_cast<std::size_t>(count_++ % kWindow)] = {
        rtt, t1 - t0 + (t2 - t1 - (t3 - t0)) / 2, t3};
    const auto n = std::min<std::uint64_t>(count_, kWindow);
    best_ = samples_[0];
    for (std::size_t i = 1; i < n; ++i) {
      // Age weighs in through the drift bound: an old sample is worth its round trip plus its
      // drift.
      if (cost(samples_[i], t3) < cost(best_, t3)) best_ = samples_[i];
    }
    round_trip_ = rtt;
    return true;
  }
  [[nodiscard]] bool valid() const noexcept { return count_ > 0; }
  [[nodiscard]] rt::Nanos offset() const noexcept { return rt::Nanos{best_.offset}; }
  [[nodiscard]] rt::Nanos uncertainty(rt::Time now_local) const noexcept {
    return rt::Nanos{cost(best_, rt::ns_of(now_local))};
  }
  [[nodiscard]] rt::Nanos round_trip() const noexcept { return rt::Nanos{round_trip_}; }  // newest
  // A stamp of the remote box in local time.
  [[nodiscard]] rt::Time to_local(rt::Stamp remote) const noexcept {
    return rt::time_from_ns(remote.ns - best_.offset);
  }

 private:
  struct Sample {
    std::int64_t rtt = 0, offset = 0, at = 0;
  };
  [[nodiscard]] static std::int64_t cost(const Sample& s, std::int64_t now) noexcept {
    return s.rtt / 2 +
           static_cast<std::int64_t>(kDriftBound *
                                     static_cast<double>(std::max<std::int64_t>(0, now - s.at)));
  }
  std::array<Sample, kWindow> samples_{};
  Sample best_{};
  std::uint64_t count_ = 0;
  std::int64_t round_trip_ = 0;
};

}  // namespace drivers
