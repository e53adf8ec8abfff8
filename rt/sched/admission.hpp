// Admission: may these tasks run on this host, where, and in which variant. Called with the union
// of everything that runs with real-time priority on the host, at start and at each mode change.
//
//   1. Ranks are rate-monotonic over all tasks; FIFO priority = 80 - rank. Platform tasks
//      (sentinels, watchdog) stand above with a priority of their own.
//   2. Pinned tasks stay on their core. Free ones are placed by first-fit decreasing (largest
//      utilisation first, ties by registration, cores in the order given); the fit test is the
//      exact response-time analysis of the whole core.
//   3. A core is refused above `core_limit` (real-time with switch costs, plus declared best
//      effort), or if any task has R > D. The limit is 0.90 because the kernel's fair server takes
//      up to 5 % of a core above FIFO.
//   4. Static choices are tried in order of preference: fewest steps down over all tasks; of ties
//      the one in which the later task steps down. The first combination that fits, at any levels,
//      is taken. A choice that is ruled out is skipped and named. If the last one (the floor) does
//      not fit either, the request is refused.
//   5. Within a combination all tasks start at level 0. While the set does not fit, one task is
//      lowered by one level: the next entry of `degrade_order`, or, if that list is empty, the task
//      with the largest utilisation (a step then costs the smallest relative loss per freed CPU;
//      ties: firm before hard, then registration). Steps that turn out not to be needed are taken
//      back, last first.
//   6. Pool workers (task_spec.hpp) stand on another core than their parent and each other; their
//      level is the parent's. Release jitter and join wait are iterated to a fixed point over all
//      cores.
// Same input, same answer. Other modes: mode_table.hpp.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rt/sched/analysis.hpp"
#include "rt/sched/task_spec.hpp"

namespace rt {

inline constexpr int kTopTaskPriority = 80;  // of rank 0
inline constexpr int kSentinelPriority = 95;
inline constexpr int kWatchdogPriority = 94;

// Where a platform task runs, and when it wakes up.
enum class PlatformWakes : std::uint8_t {
  kItself,  // at the rate of its spec, on its core; with no core in the spec on every one that has
            // a task
  kAtReleases,  // a sentinel: on every core that has a task of its box, at each instant at which one of
                // them is released. Its spec's rate is not used
  kOnceABox,  // a watchdog: at its rate, on the CPU with the highest number that has a task of its box
};

// Runs above every task. Each box is a process of its own, with sentinels and a watchdog of its
// own, also where the boxes share a core.
struct PlatformTask {
  TaskSpec spec;
  int priority = kSentinelPriority;
  PlatformWakes wakes = PlatformWakes::kItself;
};

// Ordinary threads with a declared share of a core: link, codec, console, log, report.
struct BestEffortLoad {
  std::string name;
  double share = 0;         // of one core, 0..1
  std::optional<int> core;  // index into cpus; empty: may run on any, and is spread over what is
                            // left below the limit
};

struct AdmissionRequest {
  std::vector<TaskSpec> tasks;
  std::vector<PlatformTask> platform;
  std::vector<BestEffortLoad> best_effort;
  std::vector<int> cpus;                   // CPU numbers; TaskSpec::core indexes this list
  std::vector<std::string> degrade_order;  // task names; each entry lowers that task by one level;
                                           // when given, tasks not named are never lowered
  double core_limit = 0.90;
  AnalysisOptions analysis;
};

struct AdmittedTask {
  std::string name;
  Box box = Box::kOperator;
  int core = -1;  // index into cpus; -1: not placed
  int cpu = -1;
  int rank = 0;
  int priority = 0;     // SCHED_FIFO
  int level = 0;        // variant in force at the start
  int last_level = 0;   // run-time degradation goes no further
  std::string variant;  // its name; empty if the task has one
  std::string choice;   // static choice; empty if it has none
  std::string parent;   // of a pool worker
  Nanos C{0}, T{0}, D{0}, J{0}, B{0}, R{0},
      slack{0};        // J of a worker: with its parent's latest fork
  Nanos join_wait{0};  // of a task with workers: what waiting for them adds; in C
  double utilisation = 0;
};

struct AdmittedCore {
  int cpu = -1;
  double utilisation = 0;  // real-time, with platform tasks and switch costs
  double best_effort = 0;  // pinned here
  double liu_layland = 1, hyperbolic = 1;
  bool schedulable = false;
  double growth = 0;  // factor by which all budgets of this core may grow; infinite if unused
};

struct Admission {
  bool admitted = false;
  std::string refusal;                 // one line: the task and the figures; empty if admitted
  std::vector<AdmittedTask> tasks;     // as in the request
  std::vector<AdmittedTask> platform;  // one row per instance: "sentinel@0"; a sentinel has
                                       // one for each rate that no faster one covers
  std::vector<AdmittedCore> cores;     // as in cpus
  double floating_best_effort = 0;     // declared without a core
  double core_limit = 0.90;
  double growth = 0;  // factor by which all budgets of the host may grow
  double spare =
      0;  // of a core, below the limit, when all that is declared runs: over all cores, best effort taken off
  std::vector<std::string> choices;  // each task with static choices: which it runs, and why
  std::vector<std::string> steps;    // each lowering: which task, from what to what, and why
};

// Never throws for a set that does not fit. A malformed request (no CPU, no budget, unknown name in
// degrade_order, core index out of range, more ranks than priorities, catch_up without a Ring, a
// worker that does not match its parent, too many combinations of choices) is a refusal too.
[[nodiscard]] Admission admit(const AdmissionRequest& request);

// What is malformed about a request, in one line; empty if nothing is.
[[nodiscard]] std::string problem_of(const AdmissionRequest& request);

// The request's tasks with the admitted static choices settled: their levels in `variants`.
[[nodiscard]] std::vector<TaskSpec> settled_as(const Admission& admission,
                                               std::span<const TaskSpec> tasks);

// The decision for people: steps, one row per task, one per core, the verdict.
[[nodiscard]] std::string report_table(const Admission& admission);

// The request's tasks with the admitted cores fixed, for the admission of another mode: a running
// thread is not moved.
[[nodiscard]] std::vector<TaskSpec> pinned_as(const Admission& admission,
                                              std::span<const TaskSpec> tasks);

// CPUs of this process's affinity mask, ascending.
[[nodiscard]] std::vector<int> affinity_cpus();

}  // namespace rt
