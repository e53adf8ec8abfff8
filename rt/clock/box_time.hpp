// A box's clock as an affine image of the host's monotonic clock:
//   box = offset + host + host * ppm * 1e-6, in integers, strictly increasing for |ppm| < 1e5.
// In the demo the robot box runs 1000 s ahead and 50 ppm fast, so a stamp that crossed the link
// unconverted shows at once.
#pragma once

#include <time.h>

#include <cstdint>

#include "rt/time.hpp"

namespace rt {

struct BoxTime {
  std::int64_t offset_ns = 0;
  std::int64_t ppm = 0;

  [[nodiscard]] Time from_host(std::int64_t host_ns) const noexcept {
    return time_from_ns(offset_ns + host_ns + scaled(host_ns));
  }
  // Smallest host instant whose box time is at or after `t`.
  [[nodiscard]] std::int64_t to_host(Time t) const noexcept {
    const std::int64_t target = ns_of(t) - offset_ns;
    __extension__ using Wide = __int128;
    auto host = static_cast<std::int64_t>(static_cast<Wide>(target) * 1000000 / (1000000 + ppm));
    while (host + scaled(host) >= target) --host;
    while (host + scaled(host) < target) ++host;
    return host;
  }

 private:
  [[nodiscard]] std::int64_t scaled(std::int64_t host_ns) const noexcept {
    __extension__ using Wide = __int128;
    const Wide product = static_cast<Wide>(host_ns) * ppm;
    return static_cast<std::int64_t>(product >= 0 ? product / 1000000
                                                  : -((-product + 999999) / 1000000));
  }
};

[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  timespec ts{};
  clock_gettime(CLOCK_MONOTONIC, &ts);
  return ts.tv_sec * 1000000000LL + ts.tv_nsec;
}

[[nodiscard]] inline std::int64_t thread_cpu_ns() noexcept {
  timespec ts{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ts);
  return ts.tv_sec * 1000000000LL + ts.tv_nsec;
}

}  // namespace rt
