// teletact bench haptic: what a tick costs. Thread CPU of a whole step in contact with the blend
// running, of every method on the same recorded hand and windows; instructions by callgrind as the
// difference of two run lengths, on a small and on a large map, with each effect, and against a
// build without effects; the reduction of the published method over one full ray cast.
//
// Limits: a tick's thread CPU p50 <= 3, p99 <= 25 us, its instructions <= 17,500 (mean) and
// <= 75,000 (p99: 25 us at 3 a ns), within 10 % the same on both maps, within 8 those of
// a build without effects where none is asked for; no allocation, no lock; the reduction p50 <= 80
// us. The tick is judged beside others too: its time leaves out theirs. Not measured: the reduction
// beside others, counts without valgrind or guard.
#pragma once

#include <map>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct HapticBenchOptions {
  int passes = 5;
  bool instructions = true;  // needs valgrind and the counting programs beside this one
  std::string folder;        // of the recorded runs; empty: a temporary one
  long count_ticks = 1000;   // of the short counted run; the long one has twice as many
  std::string programs;      // folder of the counting programs; empty: where this program is
};

struct HapticMethodRow {
  std::string method;
  double p50_us = 0, p99_us = 0, max_us = 0;  // ticks in contact
  double free_p50_us = 0, free_p99_us = 0;
  std::size_t contact = 0;
};

struct HapticBenchResult {
  std::vector<HapticMethodRow> methods;  // the first is the product's
  double other_load = 0;                 // cores, while times were measured
  double clock_us = 0;                   // of the two clock readings, which are in every figure
  double reduction_p50_us = 0, reduction_p99_us = 0;
  int blocks_512 = 0, blocks_64 = 0;
  std::string not_counted;                           // why there are no instructions
  double instructions_512 = 0, instructions_64 = 0;  // a tick, mean
  double instructions_p99 = 0;                       // of the ticks on the large map
  std::map<std::string, double> effects;             // beyond a tick without effects
  double none_over_plain = 0;  // no effect asked for, against a build without effects
  bool guarded = false;
  double allocations = 0, locks = 0;  // inside of step()

  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;

 private:
  void print_instructions(std::ostream& out) const;
};

// Instructions of each of the first `ticks` ticks of a recorded run, by the counting program in the
// folder `programs`.
[[nodiscard]] std::vector<double> tick_instructions(const std::string& programs,
                                                    const std::string& run, long ticks,
                                                    const std::string& scratch);

// Throws std::runtime_error when the folder can not be written.
[[nodiscard]] HapticBenchResult bench_haptic(std::ostream& progress,
                                             const HapticBenchOptions& options);

}  // namespace teletact
