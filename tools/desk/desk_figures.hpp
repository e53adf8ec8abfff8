// What a page cost and how quick it was, as figures: console.* of docs/metrics.md. One thread.
#pragma once

#include <cstddef>
#include <vector>

#include "rt/quantile.hpp"

namespace teletact {

// The newest kMost values, and a percentile of them.
class NewestValues {
 public:
  static constexpr std::size_t kMost = 4096;
  void add(double v) {
    if (values_.size() < kMost)
      values_.push_back(v);
    else
      values_[all_ % kMost] = v;
    ++all_;
  }
  // share in 0..1; -1: there is none.
  [[nodiscard]] double percentile(double share) const { return rt::quantile(values_, share, -1); }
  [[nodiscard]] std::size_t all() const noexcept { return all_; }

 private:
  std::vector<double> values_;
  std::size_t all_ = 0;
};

struct DeskFigures {
  NewestValues intent_ms;  // from its arrival to when it became an input of a task
  NewestValues mesh_ms;    // from when fusion made a delta to when the server had it
  double cpu_s = 0;        // of the views and of the server's thread, with somebody there
  double seconds = 0;      // with somebody there
  double pictures = 0;     // sent in that time
};

}  // namespace teletact
