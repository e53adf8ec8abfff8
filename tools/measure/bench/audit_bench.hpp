// What the audit of one job costs: the readings of the clocks and kernel counters that the real
// executor takes around a job, and the record's way into its ring.
#pragma once

#include <ostream>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct AuditBenchResult {
  double job_ns = 0;        // everything the executor adds to a job, median over rounds
  double parts_ns[4] = {};  // clocks, thread CPU clock, getrusage, schedstat
  double other_load = 0;    // cores, meanwhile
  // A job at most 2 us; not measured beside others.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

[[nodiscard]] AuditBenchResult bench_audit(int rounds);

}  // namespace teletact
