#include "tools/measure/bench/paired.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "rt/quantile.hpp"

namespace teletact {

namespace {
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kWanted = 0.95;
}  // namespace

PairedDifference paired(std::span<const double> with, std::span<const double> without) {
  PairedDifference out;
  std::vector<double> d;
  for (std::size_t i = 0; i < std::min(with.size(), without.size()); ++i)
    d.push_back(with[i] - without[i]);
  out.pairs = static_cast<int>(d.size());
  out.median = out.low = out.high = kNaN;
  if (d.empty()) return out;
  std::sort(d.begin(), d.end());
  out.median = rt::quantile_of_sorted(std::span<const double>(d), 0.5);
  // The k-th from either end holds the median with 1 - 2 P(fewer than k of n are above it): the
  // largest k that still reaches 95 %, else the first.
  const auto n = static_cast<double>(d.size());
  double term = std::pow(0.5, n), below = term;
  std::size_t k = 1;
  out.coverage = 1 - 2 * below;
  for (std::size_t next = 2; 2 * next <= d.size(); ++next) {
    const auto i = static_cast<double>(next - 1);
    term *= (n - i + 1) / i;
    below += term;
    if (1 - 2 * below < kWanted) break;
    k = next;
    out.coverage = 1 - 2 * below;
  }
  out.low = d[k - 1];
  out.high = d[d.size() - k];
  return out;
}

}  // namespace teletact
