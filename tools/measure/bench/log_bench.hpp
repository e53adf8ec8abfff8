// Cost of one record of the real-time log on the writing thread (part of teletact bench audit).
#pragma once

#include <ostream>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct LogBenchResult {
  double record_ns = 0;         // median over rounds of the mean of 512 records, ring with room
  double record_p99_ns = 0;     // of those means
  double full_ns = 0;           // the same when the ring is full: dropped and counted
  double with_clock_ns = 0;     // including one reading of the clock
  long heap_bytes = 0;          // growth of the heap over all records: 0
  long voluntary_switches = 0;  // of the writing thread over all records: 0 (it never blocked)
  double other_load = 0;        // cores, meanwhile
  // A record at most 100 ns (not measured beside others); nothing allocated, nothing waited for.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

[[nodiscard]] LogBenchResult bench_log(int rounds);

}  // namespace teletact
