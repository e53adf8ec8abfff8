// What a job costs in virtual time. A cost is a function of (seed, task, k, level) and never of the
// machine that runs the simulation.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "rt/random.hpp"
#include "rt/time.hpp"

namespace rt {

class CostModel {
 public:
  virtual ~CostModel() = default;
  [[nodiscard]] virtual Nanos cost(std::uint16_t task, std::uint64_t k, int level) noexcept = 0;
};

// A distribution by its quantiles: value[i] is the quantile i / (n - 1) by nearest rank
// (rt/quantile.hpp). Draws interpolate between them.
struct CostQuantiles {
  std::vector<std::int64_t> value_ns;

  [[nodiscard]] std::int64_t at(double q) const noexcept {
    if (value_ns.empty()) return 1;
    const double x = std::clamp(q, 0.0, 1.0) * static_cast<double>(value_ns.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(x), value_ns.size() - 1);
    const std::size_t j = std::min(i + 1, value_ns.size() - 1);
    const double f = x - static_cast<double>(i);
    return value_ns[i] +
           static_cast<std::int64_t>(static_cast<double>(value_ns[j] - value_ns[i]) * f);
  }
};

// Draws each job's cost from the quantiles of its task and level.
class QuantileCosts final : public CostModel {
 public:
  // tables[task][level]; a missing table costs 1 ns.
  QuantileCosts(std::uint64_t seed, std::vector<std::vector<CostQuantiles>> tables)
      : seed_(seed), tables_(std::move(tables)) {}
  [[nodiscard]] Nanos cost(std::uint16_t task, std::uint64_t k, int level) noexcept override {
    if (task >= tables_.size() || static_cast<std::size_t>(level) >= tables_[task].size()) {
      return Nanos{1};
    }
    Random random(mix64(seed_, task), k);
    return Nanos{std::max<std::int64_t>(
        1, tables_[task][static_cast<std::size_t>(level)].at(random.uniform()))};
  }

 private:
  std::uint64_t seed_;
  std::vector<std::vector<CostQuantiles>> tables_;
};

}  // namespace rt
