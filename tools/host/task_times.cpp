#include "tools/host/task_times.hpp"

#include <algorithm>

#include "rt/quantile.hpp"

namespace teletact {

std::int64_t SlackTimes::quantile(double q) const noexcept {
  const std::uint64_t late = past.count(), rank = rt::quantile_rank(q, late + left.count());
  // The jobs in order of slack: first the late ones, latest first.
  return rank <= late ? -past.at_rank(late - rank + 1) : left.at_rank(rank - late);
}

TaskAllocations allocations_of(const rt::TaskLog& task) {
  std::vector<std::int32_t> n;
  for (const rt::JobRecord& r : task.jobs) {
    if (r.allocations != rt::kNotCounted) n.push_back(r.allocations);
  }
  TaskAllocations a;
  a.jobs = n.size();
  if (n.empty()) return a;
  std::sort(n.begin(), n.end());
  a.p50 = rt::quantile_of_sorted(std::span(n), 0.5);
  a.p99 = rt::quantile_of_sorted(std::span(n), 0.99);
  a.max = n.back();
  for (const std::int32_t v : n) a.total += v;
  return a;
}

TaskTimes times_of(const rt::TaskLog& task) {
  TaskTimes t;
  for (const auto& j : task.jobs) {
    t.lateness.record(j.lateness_ns());
    t.response.record(j.end_ns - j.release_ns);
    t.cpu.record(j.cpu_ns);
    t.slack.record(j.deadline_ns - j.end_ns);
  }
  return t;
}

std::vector<BudgetCheck> check_budget(const rt::TaskLog& task, const rt::TaskBlame& blame) {
  std::vector<BudgetCheck> out;
  for (int level = 0; level < task.spec.levels(); ++level) {
    BudgetCheck c;
    c.level = level;
    c.budget_ns = task.spec.budget_of(level).count();
    std::vector<std::int64_t> cpu;
    for (std::size_t i = 0; i < task.jobs.size(); ++i) {
      if (task.jobs[i].level != level) continue;
      if (blame.jobs[i].charged > 0) {
        ++c.charged;
      } else {
        cpu.push_back(task.jobs[i].cpu_ns);
      }
    }
    c.jobs = cpu.size();
    if (c.jobs + c.charged == 0) continue;
    c.cpu_p999_ns = rt::quantile_in_place(std::span(cpu), 0.999);
    out.push_back(c);
  }
  return out;
}

}  // namespace teletact
