// teletact bench days: does a run that goes on for days stay small?
//
// The schedule of the default scene with stub bodies on the virtual clock (two cores): every job
// record of both boxes goes through its store, no body is called. Measured: resident memory after
// each simulated minute, bytes of the stores, and how long a report of what is left takes.
//
// Limits: memory at the end at most 2 % above that after the first minute, the stores never above
// their caps, every record whole or counted, the report in at most 30 s.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct DaysOptions {
  double hours = 1;
  std::string folder;  // for the stores; removed at the end if empty
  std::uint64_t cap_bytes = std::uint64_t{256} << 20U;  // of each box
  bool in_memory = false;                               // no store: what it would be without
};

struct DaysResult {
  double hours = 0, wall_s = 0, report_s = 0;
  std::uint64_t jobs = 0, whole = 0, lost = 0;       // lost: neither whole nor counted
  double first_MiB = 0, last_MiB = 0, most_MiB = 0;  // resident, from the first minute on
  double disk_MiB = 0, cap_MiB = 0;                  // both boxes
  std::vector<double> minutes_MiB;                   // resident after each minute
  std::string host;

  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  [[nodiscard]] std::string page(const std::string& command) const;  // of docs/measured
};

[[nodiscard]] DaysResult bench_days(std::ostream& progress, const DaysOptions& options);

}  // namespace teletact
