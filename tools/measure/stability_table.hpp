// What `teletact stability` prints: of each case one row a method, the limits and the published
// figures of the peers.
#pragma once

#include <cstddef>
#include <limits>
#include <map>
#include <string>

#include "tools/measure/stability/gates.hpp"

namespace teletact {

// The largest figures of one case and one method over its settings.
struct StabilityTally {
  // Settings; of them within all limits; failed where the optimum fails too, everywhere.
  int settings = 0, within = 0, field_bound = 0;
  double margin = 1;
  double j_N = 0, j_raw_N = 0, guard_share = 0, lag_ms = 0;
  // Proxy to field optimum (95 % of the ticks), and off the surface of the blended field where a
  // run has no optimum.
  double position_mm = std::numeric_limits<double>::quiet_NaN(), off_mm = position_mm;
  double cpu_p50_us = 0, cpu_p99_us = 0, cpu_max_us = 0;
  bool counted = false;  // allocations and locks
  // Under the passivity controller: least E + booked + credit, settings that are answered otherwise
  // without it.
  bool controlled = false;
  double energy_min_mJ = 0;
  int controller_acts = 0;
  // Of each check the one with the least margin: of all, and of those failed where the optimum is
  // not.
  std::map<std::string, stability::Check> worst, worst_alone;
  std::map<std::string, std::pair<double, double>>
      span;  // of each check the least and the largest limit

  [[nodiscard]] int failed() const { return settings - within; }
  [[nodiscard]] int failed_alone() const { return failed() - field_bound; }
  // The energy kept, and nothing changed where nothing had to be.
  [[nodiscard]] bool controller_passes() const;
  [[nodiscard]] double controller_margin() const;  // share of the 1 mJ that is left
  void take(const stability::Gated& gated, bool verbose);
  void take(const StabilityTally& other);
};

void print_table_head();
// `fused`: of the fused fields. A row of `method`; `judged`: with its limits and what it misses.
void print_row(const stability::Case& c, const std::string& method, const StabilityTally& t,
               bool fused, bool judged);
// The limits in words and what is published of the peers.
void print_published(const stability::Case& c);

}  // namespace teletact
