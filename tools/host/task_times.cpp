#include "tools/host/task_times.hpp"

#include <algorithm>
#include <cmath>

namespace teletact {

std::int64_t SlackTimes::quantile(double q) const noexcept {
  const auto all = static_cast<double>(left.count() + past.count());
  const auto late = static_cast<double>(past.count());
  if (all <= 0) return 0;
  const double rank = std::clamp(std::ceil(q * all - 1e-9), 1.0, all);
  // The jobs in order of slack: first the late ones, latest first. The half keeps a rank the same when
  // the histogram turns its share back into one by rounding up.
  if (rank <= late) return -past.quantile((late - rank + 0.5) / late);
  return left.quantile((rank - late - 0.5) / static_cast<double>(left.count()));
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
  const auto at = [&](double q) {
    const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(n.size())));
    return static_cast<double>(n[std::max<std::size_t>(1, rank) - 1]);
  };
  a.p50 = at(0.5);
  a.p99 = at(0.99);
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
    if (!cpu.empty()) {
      const auto rank =
          static_cast<std::size_t>(std::ceil(0.999 * static_cast<double>(cpu.size()) - 1e-9));
      const auto at = cpu.begin() + static_cast<std::ptrdiff_t>(std::max<std::size_t>(rank, 1) - 1);
      std::nth_element(cpu.begin(), at, cpu.end());
      c.cpu_p999_ns = *at;
    }
    out.push_back(c);
  }
  return out;
}

}  // namespace teletact
