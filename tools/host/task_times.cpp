#include "tools/host/task_times.hpp"

#include <algorithm>

#include "rt/audit/task_past.hpp"
#include "rt/quantile.hpp"

namespace teletact {

std::uint64_t jobs_of(const rt::TaskLog& task) noexcept {
  return task.jobs.size() + (task.past ? task.past->jobs : 0);
}

int last_level_of(const rt::TaskLog& task) noexcept {
  if (!task.jobs.empty()) return task.jobs.back().level;
  return task.past && task.past->jobs > 0 ? task.past->last_level : task.level;
}

std::int64_t cpu_quantile(const rt::TaskLog& task, double q) {
  if (task.past) {
    rt::Histogram cpu = task.past->cpu;
    for (const auto& j : task.jobs) cpu.record(j.cpu_ns);
    return cpu.quantile(q);
  }
  std::vector<std::int64_t> cpu;
  for (const auto& j : task.jobs) cpu.push_back(j.cpu_ns);
  return rt::quantile_in_place(std::span(cpu), q);
}

namespace {

TaskAllocations allocations_with_past(const rt::TaskLog& task) {
  rt::Histogram n = task.past->allocations;
  for (const rt::JobRecord& r : task.jobs) {
    if (r.allocations != rt::kNotCounted) n.record(std::int64_t{r.allocations});
  }
  TaskAllocations a;
  a.jobs = n.count();
  a.p50 = static_cast<double>(n.quantile(0.5));
  a.p99 = static_cast<double>(n.quantile(0.99));
  a.max = static_cast<double>(n.max());
  a.total = n.mean() * static_cast<double>(n.count());
  return a;
}

}  // namespace

TaskAllocations allocations_of(const rt::TaskLog& task) {
  if (task.past) return allocations_with_past(task);
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
  if (task.past) t = {task.past->lateness, task.past->response, task.past->cpu, task.past->slack};
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
    const rt::LevelPast* past = nullptr;
    if (task.past && static_cast<std::size_t>(level) < task.past->levels.size())
      past = &task.past->levels[static_cast<std::size_t>(level)];
    if (past != nullptr) c.charged = past->charged;
    std::vector<std::int64_t> cpu;
    for (std::size_t i = 0; i < task.jobs.size(); ++i) {
      if (task.jobs[i].level != level) continue;
      if (blame.jobs[i].charged > 0) {
        ++c.charged;
      } else {
        cpu.push_back(task.jobs[i].cpu_ns);
      }
    }
    c.jobs = cpu.size() + (past != nullptr ? past->jobs : 0);
    if (c.jobs + c.charged == 0) continue;
    if (past != nullptr && past->jobs > 0) {
      rt::Histogram all = past->cpu;
      for (const std::int64_t ns : cpu) all.record(ns);
      c.cpu_p999_ns = all.quantile(0.999);
    } else {
      c.cpu_p999_ns = rt::quantile_in_place(std::span(cpu), 0.999);
    }
    out.push_back(c);
  }
  return out;
}

}  // namespace teletact
