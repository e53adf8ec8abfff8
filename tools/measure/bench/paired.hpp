// Differences of pairs measured in turn: what two sides of a bench share, the machine's mood above
// all, falls out of them. Pure.
#pragma once

#include <span>

namespace teletact {

// Of pairs measured in turn: median of with - without and its interval, from the order statistics
// alone, so that it holds for any distribution.
struct PairedDifference {
  int pairs = 0;
  double median = 0, low = 0, high = 0;  // NaN: no pair
  double coverage = 0;  // that the interval holds the median; fewer than 6 pairs reach no 95 %
};
[[nodiscard]] PairedDifference paired(std::span<const double> with,
                                      std::span<const double> without);

}  // namespace teletact
