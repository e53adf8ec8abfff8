#include "tools/desk/task_watch.hpp"

#include <algorithm>
#include <map>

#include "rt/quantile.hpp"

namespace teletact {

std::string TaskFigures::blame_text() const {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < by_cause.size(); ++i)
    if (by_cause[i] > 0) order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [this](std::size_t a, std::size_t b) { return by_cause[a] > by_cause[b]; });
  std::string text;
  for (const std::size_t i : order) {
    text += (text.empty() ? "" : ", ") + std::to_string(by_cause[i]) + " ";
    text += rt::name_of(static_cast<rt::Cause>(i));
  }
  return text;
}

void TaskWatch::tasks(const rt::RunLog& header) {
  const std::scoped_lock lock(mutex_);
  for (const rt::TaskLog& t : header.tasks) {
    rt::TaskLog& mine = new_tasks_.emplace_back();
    mine.spec = t.spec;
    mine.id = t.id;
    mine.core = t.core;
    mine.level = t.level;
    mine.work_min = t.work_min;
    mine.work_max = t.work_max;
  }
}

template <class Record>
void TaskWatch::put(std::vector<Record>& waiting, const Record& record) {
  const std::scoped_lock lock(mutex_);
  if (waiting.size() >= kMostWaiting) {
    ++dropped_;
    return;
  }
  waiting.push_back(record);
}

void TaskWatch::add(const rt::JobRecord& record) { put(jobs_, record); }
void TaskWatch::add(const rt::SentinelRecord& record) { put(sentinels_, record); }

std::uint64_t TaskWatch::dropped() const {
  const std::scoped_lock lock(mutex_);
  return dropped_;
}

// A late start is blamed on the platform by the sentinel of its core, whose sample may have come
// with the look before.
void TaskWatch::look() {
  std::vector<rt::JobRecord> jobs;
  std::vector<rt::SentinelRecord> sentinels;
  {
    const std::scoped_lock lock(mutex_);
    jobs.swap(jobs_);
    sentinels.swap(sentinels_);
    for (rt::TaskLog& t : new_tasks_) rows_.emplace_back().task = std::move(t);
    new_tasks_.clear();
  }
  heard_.erase(heard_.begin(), heard_.begin() + static_cast<std::ptrdiff_t>(heard_before_));
  heard_before_ = heard_.size();
  heard_.insert(heard_.end(), sentinels.begin(), sentinels.end());
  std::map<int, rt::CoreGaps> gaps;
  for (const Row& row : rows_) gaps.try_emplace(row.task.core, heard_, row.task.core);
  for (const rt::JobRecord& r : jobs) {
    const auto row =
        std::find_if(rows_.begin(), rows_.end(), [&](const Row& w) { return w.task.id == r.task; });
    if (row == rows_.end()) continue;
    row->counts.add(r, row->walk.next(r, row->task, gaps.at(row->task.core)));
    row->jobs.push_back({r.release_ns, r.lateness_ns(), r.cpu_ns});
    while (row->jobs.front().release_ns <= r.release_ns - kWindow.count()) row->jobs.pop_front();
  }
}

std::vector<TaskFigures> TaskWatch::now() const {
  std::vector<TaskFigures> all;
  for (const Row& row : rows_) {
    TaskFigures& f = all.emplace_back();
    f.name = row.task.spec.name;
    f.box = row.task.spec.box == rt::Box::kOperator ? "operator" : "robot";
    const double period_s = rt::seconds(row.task.spec.period());
    f.hz = period_s > 0 ? 1 / period_s : 0;
    f.misses = row.counts.miss_total;
    f.by_cause = row.counts.misses;
    f.jobs = row.jobs.size();
    if (row.jobs.empty()) continue;
    std::vector<std::int64_t> late;
    double cpu_ns = 0;
    for (const Job& j : row.jobs) {
      late.push_back(j.late_ns);
      cpu_ns += static_cast<double>(j.cpu_ns);
    }
    f.late_p95_us = 1e-3 * static_cast<double>(rt::quantile_in_place(std::span(late), 0.95));
    f.cpu_ms = 1e-6 * cpu_ns / static_cast<double>(row.jobs.size());
    f.cpu_share = 1e-3 * f.cpu_ms * f.hz;
  }
  return all;
}

}  // namespace teletact
