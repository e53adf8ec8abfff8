// Inside of admission: the analysis rows of a host at a given placement and given levels, fork and
// join between cores included (analysis.hpp has the formulas).
#pragma once

#include <string>
#include <vector>

#include "rt/sched/admission_levels.hpp"

namespace rt::detail {

[[nodiscard]] std::string format(const char* pattern, double value);
[[nodiscard]] std::string shown_name(const TaskSpec& spec);

// What stands on one core: analysis rows, and whose they are.
struct CoreSet {
  std::vector<AnalysisTask> rows;
  std::vector<std::string> names;
  std::vector<std::size_t> tasks;  // rows platform_rows.. belong to these tasks of the request
  std::size_t platform_rows = 0;
};

// What fork and join add to a row: release jitter to a worker, execution time to its parent.
struct Coupling {
  std::vector<Nanos> fork, wait;  // per task
  std::string problem;            // a fork or a join without a bound
};

// `placed`: core of each task, -1 nowhere. `levels`: of each task; a worker's entry is not used.
class HostRows {
 public:
  // Keeps a reference to the request.
  explicit HostRows(const AdmissionRequest& request);

  [[nodiscard]] AnalysisTask row_of(std::size_t i, const std::vector<int>& levels,
                                    const Coupling& k) const;
  // What of the platform stands on a core, with the rates at which it wakes there.
  [[nodiscard]] std::vector<PlatformTask> platform_on(int core,
                                                      const std::vector<int>& placed) const;
  [[nodiscard]] CoreSet core_set(int core, const std::vector<int>& placed,
                                 const std::vector<int>& levels, const Coupling& k) const;
  // The least fixed point of latest forks and join waits over all cores. Both only grow from one
  // round to the next, so the iteration ends at the fixed point or when a parent's wait exceeds two
  // periods.
  [[nodiscard]] Coupling couple(const std::vector<int>& placed,
                                const std::vector<int>& levels) const;
  // Empty if the core is fine; else the figures.
  [[nodiscard]] std::string core_problem(int core, const CoreSet& set) const;
  // Problem after placing task i, or empty. Checks its core, and all cores if fork-join couples
  // them.
  [[nodiscard]] std::string problem_after(std::size_t i, const std::vector<int>& placed,
                                          const std::vector<int>& levels) const;

 protected:
  // A worker's level is its parent's.
  [[nodiscard]] int level_of(std::size_t i, const std::vector<int>& levels) const;
  [[nodiscard]] int cores() const { return static_cast<int>(req_.cpus.size()); }
  [[nodiscard]] int cpu(int core) const { return req_.cpus[static_cast<std::size_t>(core)]; }

  const AdmissionRequest& req_;
  std::vector<int> ranks_;
  std::vector<int> parent_;  // row of a worker's parent; -1: not a worker
  bool has_workers_ = false;
  std::vector<double> pinned_load_;
  double floating_load_ = 0;

 private:
  [[nodiscard]] int forks_of(std::size_t i) const;
  [[nodiscard]] bool one_pool(std::size_t i, std::size_t j) const;
  void couple_one(std::size_t p, const std::vector<int>& placed, const std::vector<int>& levels,
                  Coupling& k, bool& changed) const;
  static Variant worst_fork(const TaskSpec& spec, int level);
  static std::size_t row_in(const CoreSet& set, std::size_t task);
};

}  // namespace rt::detail
