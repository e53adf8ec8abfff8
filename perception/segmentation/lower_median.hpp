#pragma once

#include <array>
#include <cstdint>

namespace perception {

// Of the readings among the four (not 0, not 65535) the lower median (the rank rule of
// rt/quantile.hpp at 1/2); 0: there is none.
[[nodiscard]] inline std::uint16_t lower_median(
    const std::array<std::uint16_t, 4>& readings) noexcept {
  std::uint16_t sorted[4];
  int n = 0;
  for (const std::uint16_t r : readings) {
    if (r == 0 || r == 65535) continue;
    int k = n++;
    for (; k > 0 && sorted[k - 1] > r; --k) sorted[k] = sorted[k - 1];
    sorted[k] = r;
  }
  return n == 0 ? std::uint16_t{0} : sorted[(n - 1) / 2];
}

}  // namespace perception
