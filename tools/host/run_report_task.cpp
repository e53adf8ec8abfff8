// From the jobs of a task to its part of the report.
#include <algorithm>
#include <cmath>

#include "tasks/contract/table.hpp"
#include "tools/host/run_results.hpp"
#include "tools/host/task_times.hpp"

namespace teletact {

namespace {

const char* const kPolicies[] = {"skip", "catch_up", "abort", "degrade"};

ReportTask::Quantiles quantiles(const rt::Histogram& h) {
  const auto us = [&](double q) { return static_cast<double>(h.quantile(q)) * 1e-3; };
  return {us(0.5), us(0.99), us(0.999), static_cast<double>(h.max()) * 1e-3};
}

// By the graph's table; a file of another table gets a number.
std::string level_name(const rt::TaskLog& task, int level) {
  if (task.id < tasks::kTaskTable.size()) {
    const auto& row = tasks::kTaskTable[task.id];
    const auto at = static_cast<std::size_t>(level);
    if (row.name == task.spec.name && at < row.variants.size() && !row.variants[at].name.empty())
      return std::string(row.variants[at].name);
  }
  return "level " + std::to_string(level);
}

plot::Bins bins(const std::string& name, const rt::Histogram& h) {
  // Half-octave bins from 1 us: fine enough to see modes, coarse enough to read.
  plot::Bins b;
  b.name = name;
  std::vector<double> edges;
  for (double e = 1.0; e < 1e6; e *= std::sqrt(2.0)) edges.push_back(e);
  std::vector<double> count(edges.size(), 0);
  h.for_each([&](std::int64_t lower_ns, std::int64_t, std::uint64_t n) {
    const double us = static_cast<double>(lower_ns) * 1e-3;
    const auto it = std::upper_bound(edges.begin(), edges.end(), us);
    count[it == edges.begin() ? 0 : static_cast<std::size_t>(it - edges.begin() - 1)] +=
        static_cast<double>(n);
  });
  std::size_t last = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    if (count[i] > 0) last = i;
  }
  b.lower.assign(edges.begin(), edges.begin() + static_cast<std::ptrdiff_t>(last + 1));
  b.count.assign(count.begin(), count.begin() + static_cast<std::ptrdiff_t>(last + 1));
  b.upper_end = edges[std::min(last + 1, edges.size() - 1)];
  return b;
}

rt::Histogram sentinel_of(const rt::RunLog& log, int core) {
  rt::Histogram h;
  if (const auto past = log.past_sentinels.find(core); past != log.past_sentinels.end())
    h = past->second;
  for (const auto& s : log.sentinels) {
    if (s.core == core) h.record(s.late_ns);
  }
  return h;
}

}  // namespace

ReportTask report_task(const rt::RunLog& log, const rt::TaskLog& task,
                       const std::vector<BoxTotals>& totals, bool virtual_clock) {
  ReportTask r;
  r.name = task.spec.name;
  r.box = task.spec.box == rt::Box::kOperator ? "operator" : "robot";
  r.task_class = task.spec.task_class == rt::TaskClass::kHard ? "hard" : "firm";
  r.policy = kPolicies[static_cast<int>(task.spec.policy)];
  r.rate_hz = task.spec.rate.hz();
  r.core = task.core;
  r.priority = task.priority;
  const int level = last_level_of(task);
  r.budget_us = static_cast<double>(task.spec.budget_of(level).count()) * 1e-3;
  r.level = level_name(task, level);
  const rt::TaskBlame b = rt::blame(log, task);
  const auto cause = [&](rt::Cause c) { return b.misses[static_cast<std::size_t>(c)]; };
  r.completed = b.completed;
  r.aborted = b.aborted;
  r.skipped = b.skipped;
  for (const auto& t : totals) {
    if (t.task == task.id) {
      r.completed = t.totals.completed;
      r.aborted = t.totals.aborted;
      r.skipped = t.totals.skipped;
    }
  }
  const std::uint64_t tail = r.skipped > b.skipped ? r.skipped - b.skipped : 0;
  r.releases = r.completed + r.aborted + r.skipped;
  r.misses = b.miss_total + tail;
  r.own = cause(rt::Cause::kOwn);
  r.queued = cause(rt::Cause::kQueued);
  r.platform = cause(rt::Cause::kPlatform);
  r.carried = cause(rt::Cause::kCarried);
  r.charged = cause(rt::Cause::kCharged);
  r.unknown = cause(rt::Cause::kUnknown) + tail;
  if (const TaskAllocations a = allocations_of(task); a.jobs > 0) {
    r.allocations_p50 = a.p50;
    r.allocations_max = a.max;
  }
  const TaskTimes times = times_of(task);
  const rt::Histogram sentinel = sentinel_of(log, task.core);
  r.cpu_us = quantiles(times.cpu);
  r.lateness_us = quantiles(times.lateness);
  r.response_us = quantiles(times.response);
  const auto slack = [&](double q) { return 1e-3 * static_cast<double>(times.slack.quantile(q)); };
  r.slack_us = {slack(0.5), slack(0.01), slack(0.001),
                1e-3 * static_cast<double>(times.slack.least())};
  r.cpu_histogram = {bins("CPU", times.cpu)};
  r.lateness_histogram = {bins("task", times.lateness)};
  r.response_histogram = {bins("response", times.response)};
  if (!times.slack.above.empty()) r.slack_histogram.push_back(bins("left", times.slack.above));
  if (!times.slack.below.empty()) {
    r.slack_histogram.push_back(bins("deadline passed by", times.slack.below));
    r.slack_histogram.back().colour = "#b03a2e";
  }
  if (!virtual_clock && sentinel.count() > 0)
    r.lateness_histogram.push_back(bins("sentinel", sentinel));
  return r;
}

}  // namespace teletact
