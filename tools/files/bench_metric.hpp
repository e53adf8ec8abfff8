// One figure of a bench; the program puts them into its JSON (names in docs/metrics.md).
#pragma once

#include <string>

namespace teletact {

struct BenchMetric {
  std::string name;
  double value = 0;
  std::string unit;
};

}  // namespace teletact
