// TaskSpec: what the scheduler knows of a task. Everything here is stated before the start;
// priorities are derived from it (rate-monotonic), never given.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rt/time.hpp"

namespace rt {

// hard: no allocation, lock, throw, page fault or I/O in step(), proven by tests on every step.
// firm: noexcept; what libraries allocate is counted and printed.
enum class TaskClass : std::uint8_t { kHard, kFirm };

// What happens at the release after a miss (docs/timing.md).
enum class MissPolicy : std::uint8_t {
  kSkip,     // next release in the future; phase kept; the job is told how many were dropped
  kCatchUp,  // up to n jobs back to back, then as skip; only for tasks fed by a Ring
  kAbort,    // cooperative: the cancel token is set at the deadline; an aborted job commits nothing
  kDegrade,  // as skip, and the task asks for its next smaller variant
};

// A way to do the job: a level passed in Tick to the same object, level 0 the fullest. Its knobs
// are dynamic (ICP iterations, pixel step): they may change at the first hyperperiod boundary with
// no pending job.
struct Variant {
  std::string name;
  Nanos budget{0};
  // Of a task with forks only:
  Nanos until_last_fork{0};  // CPU of its own before the last fork
  // CPU of its own while workers run, summed over the forks and counted at each fork up to the
  // largest share that a worker gets there. 0 is always safe.
  Nanos overlap{0};

  Variant() = default;
  Variant(std::string name_, Nanos budget_, Nanos until_last_fork_ = Nanos{0},
          Nanos overlap_ = Nanos{0})
      : name(std::move(name_)),
        budget(budget_),
        until_last_fork(until_last_fork_),
        overlap(overlap_) {}
};

// A value of a static parameter (voxel size): chosen at start by admission, never changed
// afterwards. Each value has levels of its own.
struct StaticChoice {
  std::string name;               // "20 mm"
  std::vector<Variant> variants;  // level 0 first; at least one
  std::string ruled_out;          // why this set-up can not have it; empty: it can
};

// Fork and join. A task with `forks` hands parts of each job to pool workers on other cores and
// waits for them. Each worker is a row of its own that names its parent. A worker has its parent's
// rate, offset, deadline, policy, choices and levels. Its budget is its own: over the forks of one
// job, the sum of the largest share that any worker of the pool gets. Its release jitter is the
// parent's latest fork. That and the parent's wait for the join, which counts as execution, are
// computed (analysis.hpp). Workers block while they wait; they never spin.

// How much later than its grid a task is released from now on: where its input comes at a phase
// that is known only while it runs. It only grows, so two releases are never closer than a period,
// which is all that the analysis asks of them. Real clock only.
struct Postponed {
  std::atomic<std::int64_t> asked_ns{0};    // by any ordinary thread
  std::atomic<std::int64_t> applied_ns{0};  // by the task's thread, between two jobs
};

struct TaskSpec {
  std::string name;
  Box box = Box::kOperator;
  TaskClass task_class = TaskClass::kHard;
  Rate rate{1, 1};
  Nanos offset{0};
  Nanos deadline{0};        // relative; 0 means the period. May exceed the period.
  Nanos budget{0};          // CPU of one job (C), of the variant in force
  Nanos blocking{0};        // longest time a lower task can hold it up (B)
  Nanos jitter{0};          // release jitter (J)
  std::optional<int> core;  // index into the admitted core list; empty = placed by admission
  MissPolicy policy = MissPolicy::kSkip;
  int catch_up_max = 0;            // for kCatchUp, at least 1
  bool ring_fed = false;           // its input is a Ring: late jobs still find their own events
  int consecutive_miss_limit = 0;  // leaky bucket: above it the safe output is forced; 0 = never
  std::vector<Variant> variants;   // empty = one variant with `budget`
  // Best first, the floor last; empty = none. Admission puts the chosen one's levels in `variants`.
  std::vector<StaticChoice> choices;
  std::string choice;  // name of the chosen one, once chosen
  Nanos spin_lead{0};  // wake this much earlier and spin; admission adds it to the budget
  int forks = 0;       // of one job, at most; 0 = it has no workers
  std::string parent;  // of a pool worker: the row that forks; empty = an ordinary task
  std::shared_ptr<Postponed> postponed;  // null: it keeps the phase of its offset

  [[nodiscard]] Nanos period() const noexcept { return rate.period(); }
  [[nodiscard]] Nanos relative_deadline() const noexcept {
    return deadline.count() > 0 ? deadline : period();
  }
  [[nodiscard]] Nanos budget_of(int level) const noexcept {
    return variants.empty() ? budget : variants[static_cast<std::size_t>(level)].budget;
  }
  [[nodiscard]] bool is_worker() const noexcept { return !parent.empty(); }
  [[nodiscard]] int levels() const noexcept {
    return variants.empty() ? 1 : static_cast<int>(variants.size());
  }
};

}  // namespace rt
