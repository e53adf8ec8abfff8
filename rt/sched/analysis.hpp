// Schedulability of one core under preemptive fixed priorities: utilisation bounds, exact response
// times, and the factor by which all budgets may grow. Pure functions of integers (nanoseconds).
//
//   Liu, Layland 1973         U <= n (2^(1/n) - 1)
//   Bini, Buttazzo 2003       prod (U_i + 1) <= 2                            (hyperbolic)
//   Lehoczky 1990, Tindell, Burns, Wellings 1994: arbitrary deadlines, every job of the level-i
//   busy period, with release jitter J and blocking B:
//     w_i(q) = B_i + (q + 1) C_i + sum over j more important ceil((w_i(q) + J_j) / T_j) C_j
//     R_i    = max over q of  w_i(q) + J_i - q T_i
// Both bounds are sufficient only for D >= T without jitter and blocking; they are reported beside
// the exact answer, which alone decides. R is measured from the nominal release (J is in it), as D
// is.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "rt/sched/task_spec.hpp"
#include "rt/time.hpp"

namespace rt {

struct AnalysisTask {
  Nanos C{0};    // CPU of one job, > 0
  Nanos T{0};    // minimum distance of two nominal releases, > 0
  Nanos D{0};    // relative deadline, may exceed T
  Nanos J{0};    // release jitter
  Nanos B{0};    // longest time less important work can hold it up
  int rank = 0;  // 0 is the most important; tasks of equal rank may each delay the other
};

struct AnalysisOptions {
  // Two of these are added to every job: one switch to it, one away from it.
  Nanos switch_cost{8000};
  // A busy period beyond this is called unbounded. U > 1 is recognised without iterating.
  Nanos horizon{100'000'000'000};
};

inline constexpr Nanos kUnbounded{std::numeric_limits<std::int64_t>::max()};

struct ResponseTime {
  Nanos R{0};             // kUnbounded if it diverges
  Nanos slack{0};         // D - R; Nanos::min() if it diverges
  std::int64_t jobs = 0;  // jobs of the longest busy period of its level
  bool meets = false;     // R <= D
  [[nodiscard]] bool bounded() const noexcept { return R != kUnbounded; }
};

struct CoreAnalysis {
  std::vector<ResponseTime> tasks;  // in the order given
  double utilisation = 0;           // sum (C + 2 switches) / T
  double liu_layland = 1;           // the bound for this many tasks
  double hyperbolic = 1;            // prod (U_i + 1), to compare with 2
  bool passes_liu_layland = false;  // U below the bound, and the bound applies
  bool passes_hyperbolic = false;
  bool bounds_apply = false;  // D >= T, J = B = 0 for all
  bool schedulable = false;   // every task meets
};

[[nodiscard]] CoreAnalysis analyse(std::span<const AnalysisTask> tasks,
                                   const AnalysisOptions& = {});

// Response time of one task of the set.
[[nodiscard]] ResponseTime response_time(std::span<const AnalysisTask> tasks, std::size_t i,
                                         const AnalysisOptions& = {});

// Sum of (C + 2 switches) / T.
[[nodiscard]] double utilisation(std::span<const AnalysisTask> tasks, const AnalysisOptions& = {});

// The largest f = n / 10000 such that the set with every C replaced by ceil(f C) meets all
// deadlines and keeps its utilisation at or below `limit`; (n + 1) / 10000 does not. Below 1 the
// set does not fit as it is; 0: it never fits. Switch costs and blocking do not grow.
[[nodiscard]] double growth_factor(std::span<const AnalysisTask> tasks, double limit = 1.0,
                                   const AnalysisOptions& = {});

// Row numbers, most important first: shorter period, then shorter deadline, then order of
// registration. Periods are compared as exact fractions.
[[nodiscard]] std::vector<std::size_t> rate_monotonic_order(std::span<const TaskSpec> specs);
// The inverse: rank of each row.
[[nodiscard]] std::vector<int> rate_monotonic_ranks(std::span<const TaskSpec> specs);

// floor(1e9 den / num): a rate such as 30 Hz has releases 33 333 333 and 33 333 334 ns apart. The
// analysis counts arrivals by ceil(w / T), so only the shortest distance is safe: a longer T could
// leave out an arrival that really happens.
[[nodiscard]] Nanos minimum_distance(const Rate& rate) noexcept;

// Deadline that admission holds a task to. All policies but catch_up drop a release that lies
// before the previous job's end, so for them a D beyond the period is cut to the period.
[[nodiscard]] Nanos effective_deadline(const TaskSpec& spec) noexcept;

// One task at one level. A task that may degrade is charged the largest budget that it can reach
// from this level, in case a "smaller" variant turned out dearer; a spin lead is charged too.
[[nodiscard]] AnalysisTask analysis_task(const TaskSpec& spec, int level, int rank) noexcept;

// ---- fork and join (task_spec.hpp)
//
// The parent is analysed as if it executed while it waits for its workers (suspension-oblivious,
// hence safe for it and for everything below it); a worker as a task of the parent's period on its
// own core, released with the parent's latest fork as jitter. Each depends on the other through the
// cores: admission iterates both upwards from zero until nothing changes.

// Latest instant, from the nominal release, at which task i of the set can have spent `spent` of
// its C: with `spent` = CPU and waits before its last fork, the release jitter of its workers.
[[nodiscard]] Nanos latest_fork(std::span<const AnalysisTask> tasks, std::size_t i, Nanos spent,
                                const AnalysisOptions& = {});

// Longest time that a parent waits for worker i of the set, from fork to join, summed over `forks`
// forks between which the worker's C is shared out. With several forks, add one preemption by each
// higher task per waiting interval. Switch costs of each fork are in it.
[[nodiscard]] Nanos join_time(std::span<const AnalysisTask> tasks, std::size_t i, int forks,
                              const AnalysisOptions& = {});

struct WorkerJoin {
  Nanos C{0};     // budget of the worker
  Nanos join{0};  // its join_time
};
// What waiting adds to the parent's own CPU. One fork: the longest join beyond the parent's own
// share. Several: that share of the largest worker budget that the parent's own overlap does not
// cover, and whatever delays any of the workers at any fork.
[[nodiscard]] Nanos wait_beyond(std::span<const WorkerJoin> workers, int forks, Nanos overlap);

}  // namespace rt
