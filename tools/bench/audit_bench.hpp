// What the audit of one job costs: the readings of the clocks and kernel counters that the real
// executor takes around a job, and the record's way into its ring.
#pragma once

#include <ostream>
#include <vector>

#include "tools/bench/bench_metric.hpp"

namespace teletact {

struct AuditBenchResult {
  double job_ns = 0;        // everything the executor adds to a job, median over rounds
  double parts_ns[4] = {};  // clocks, thread CPU clock, getrusage, schedstat
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

[[nodiscard]] AuditBenchResult bench_audit(int rounds);

}  // namespace teletact
