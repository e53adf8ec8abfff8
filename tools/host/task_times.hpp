// Times of one task's jobs, for the audit and the report, and whether they kept the budget.
#pragma once

#include <cstdint>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/audit/histogram.hpp"
#include "rt/audit/run_log.hpp"

namespace teletact {

// Slack of a job: deadline - end. Negative when it was late, and the histogram knows no negative
// times, so there are two: what was left, and by how much the deadline was passed.
struct SlackTimes {
  rt::Histogram left, past;

  void record(std::int64_t slack_ns) noexcept {
    (slack_ns >= 0 ? left : past).record(slack_ns >= 0 ? slack_ns : -slack_ns);
  }
  // The quantile (rt/quantile.hpp), ns, within a bucket of the histogram (1.6 %); 0 when empty.
  [[nodiscard]] std::int64_t quantile(double q) const noexcept;
  [[nodiscard]] std::int64_t least() const noexcept {
    return past.empty() ? left.min() : -past.max();
  }
};

struct TaskTimes {
  rt::Histogram lateness, response, cpu;  // ns; response: end - release
  SlackTimes slack;
};
// Heap allocations of a task's steps, by the libraries that it uses: our own code makes none.
struct TaskAllocations {
  std::size_t jobs = 0;  // counted ones; 0: the program counted none
  double p50 = 0, p99 = 0, max = 0, total = 0;
};
[[nodiscard]] TaskAllocations allocations_of(const rt::TaskLog& task);
[[nodiscard]] TaskTimes times_of(const rt::TaskLog& task);

// p99.9 of a level's thread CPU beside the budget of that level. Jobs in which the machine charged CPU
// to the task (blame.hpp) are left out: the time was not the task's.
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
