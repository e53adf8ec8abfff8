// Times of one task's jobs, for the audit and the report, and whether they kept the budget.
#pragma once

#include <cstdint>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/audit/histogram.hpp"
#include "rt/audit/run_log.hpp"

namespace teletact {

// Slack of a job: deadline - end. `above`: what was left; `below`: by how much the deadline was
// passed.
using SlackTimes = rt::SignedHistogram;

struct TaskTimes {
  rt::Histogram lateness, response, cpu;  // ns; response: end - release
  SlackTimes slack;
};
// Heap allocations of a task's steps, by the libraries that it uses: our own code makes none.
struct TaskAllocations {
  std::size_t jobs = 0;  // counted ones; 0: the program counted none
  double p50 = 0, p99 = 0, max = 0, total = 0;
};
// Jobs of the task: those with a record and those before (TaskLog::past).
[[nodiscard]] std::uint64_t jobs_of(const rt::TaskLog& task) noexcept;
// The variant that ran last.
[[nodiscard]] int last_level_of(const rt::TaskLog& task) noexcept;
// Quantile of the thread CPU, ns: exact, or within 1.6 % where records are gone; 0 without jobs.
[[nodiscard]] std::int64_t cpu_quantile(const rt::TaskLog& task, double q);
[[nodiscard]] TaskAllocations allocations_of(const rt::TaskLog& task);
[[nodiscard]] TaskTimes times_of(const rt::TaskLog& task);

// p99.9 of a level's thread CPU beside the budget of that level. Jobs in which the machine charged
// CPU to the task (blame.hpp) are left out: the time was not the task's. Within 1.6 % above where
// records are gone.
struct BudgetCheck {
  int level = 0;
  std::uint64_t jobs = 0, charged = 0;  // counted; left out
  std::int64_t cpu_p999_ns = 0, budget_ns = 0;
  [[nodiscard]] bool kept() const noexcept { return cpu_p999_ns <= budget_ns; }
};
// One entry for each level that ran. `blame` is that of this very log.
[[nodiscard]] std::vector<BudgetCheck> check_budget(const rt::TaskLog& task,
                                                    const rt::TaskBlame& blame);

}  // namespace teletact
