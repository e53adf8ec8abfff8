// teletact bench wakeup: how late our way of waking is, beside cyclictest, in alternating slices.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct WakeupResult {
  struct Slice {
    double p50_us = 0, p99_us = 0, max_us = 0;
  };
  std::vector<Slice> plain, spin, cyclictest;                       // one a round
  double p50_plain_us = 0, p50_spin_us = 0, p50_cyclictest_us = 0;  // medians over rounds
  bool fifo = false;
  std::string remark;  // what was missing, e.g. cyclictest not installed
  // p50 to cyclictest's, with and without the lead: at most 1.6; not measured without cyclictest or
  // SCHED_FIFO.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// `rounds` rounds of one slice each of `slice_s`: ours plain, ours with a 30 us spin lead,
// cyclictest (-m -p90 -i1000, same core). 1 kHz, pinned, FIFO 90.
[[nodiscard]] WakeupResult bench_wakeup(std::ostream& progress, int rounds, double slice_s);

}  // namespace teletact
