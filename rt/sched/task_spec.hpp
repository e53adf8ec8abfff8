// TaskSpec: what the scheduler knows of a task. Everything here is stated before the start;
// priorities are derived from it (rate-monotonic), never given.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
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

// A smaller way to do the same job: a level passed in Tick to the same object. Level 0 is the full
// one. Static knobs (voxel size) are chosen at start by admission; dynamic ones (ICP iterations,
// pixel step) at the first hyperperiod boundary with no pending job.
struct Variant {
  std::string name;
  Nanos budget{0};
  bool is_static = false;
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
  int catch_up_max = 0;            // for kCatchUp
  int consecutive_miss_limit = 0;  // leaky bucket: above it the safe output is forced; 0 = never
  std::vector<Variant> variants;   // empty = one variant with `budget`
  Nanos spin_lead{0};              // wake this much earlier and spin; counted in the budget

  [[nodiscard]] Nanos period() const noexcept { return rate.period(); }
  [[nodiscard]] Nanos relative_deadline() const noexcept {
    return deadline.count() > 0 ? deadline : period();
  }
  [[nodiscard]] Nanos budget_of(int level) const noexcept {
    return variants.empty() ? budget : variants[static_cast<std::size_t>(level)].budget;
  }
  [[nodiscard]] int levels() const noexcept {
    return variants.empty() ? 1 : static_cast<int>(variants.size());
  }
};

}  // namespace rt
