// Nearest rank: the one rule for every reported quantile, percentile and median.
//
//   rule      the q-quantile of n values is the r-th smallest, with r the least rank for which r /
//             n >= q. So at least a share q of the values is not above it. No interpolation: the
//             result is one of the values.
//   rounding  r / n is compared as a double, so q means the decimal as written: 0.07 of 100 values
//             is the 7th, although 0.07 * 100 is more than 7 in double. Valid while n times
//             10^decimals is below 2^53.
//   median    q = 0.5: of an even number the lower of the two in the middle
//   ends      q <= 0 (and NaN): the smallest; q >= 1: the largest
//   empty     no rank (0); the caller decides what to report then
//   ties      equal values count as often as they occur
//   order     operator<, without NaN among the values; infinities are allowed
//
// Histograms (rt::Histogram, drivers::ExchangeHistogram) report the upper edge of the bin that
// holds that rank.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

namespace rt {

// Of n values: 1 .. n; 0 when n is 0.
[[nodiscard]] constexpr std::uint64_t quantile_rank(double q, std::uint64_t n) noexcept {
  if (n == 0) return 0;
  if (!(q > 0)) return 1;
  if (q >= 1) return n;
  const auto count = static_cast<double>(n);
  const auto reaches = [&](std::uint64_t r) { return static_cast<double>(r) / count >= q; };
  // Below 2^52 values the product is off by less than half a rank: one step puts it right.
  auto rank = std::clamp(static_cast<std::uint64_t>(q * count), std::uint64_t{1}, n);
  if (!reaches(rank)) ++rank;
  if (rank > 1 && reaches(rank - 1)) --rank;
  return rank;
}

// Of values that rise, in constant time.
template <class T>
[[nodiscard]] constexpr std::remove_const_t<T> quantile_of_sorted(
    std::span<T> sorted, double q,
    std::type_identity_t<std::remove_const_t<T>> empty = {}) noexcept {
  return sorted.empty() ? empty : sorted[quantile_rank(q, sorted.size()) - 1];
}

// Of values in any order, which it changes: linear on average, no allocation.
template <class T>
[[nodiscard]] constexpr T quantile_in_place(std::span<T> values, double q,
                                            std::type_identity_t<T> empty = {}) noexcept {
  if (values.empty()) return empty;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(quantile_rank(q, values.size()) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The same of a copy, which the caller makes.
template <class T>
[[nodiscard]] constexpr T quantile(std::vector<T> values, double q,
                                   std::type_identity_t<T> empty = {}) noexcept {
  return quantile_in_place(std::span<T>(values), q, empty);
}

// The same for a report, where NaN stands for "there is none".
[[nodiscard]] inline double quantile_or_nan(std::vector<double> values, double q) noexcept {
  return quantile_in_place(std::span(values), q, std::numeric_limits<double>::quiet_NaN());
}

}  // namespace rt
