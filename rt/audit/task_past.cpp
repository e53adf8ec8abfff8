#include "rt/audit/task_past.hpp"

#include <algorithm>

namespace rt {

namespace {

bool is_event(const JobRecord& r, const TaskLog& task, const TaskPast& past) noexcept {
  if (r.missed() || r.skipped > 0 || r.fault != past.last_fault) return true;
  if (r.severity != past.last_severity) return true;
  if (past.begun && r.level != past.last_level) return true;
  return r.cpu_ns > task.spec.budget_of(r.level).count();
}

}  // namespace

void TaskPast::add(const JobRecord& r, const TaskLog& task, const JobBlame& b,
                   std::int64_t previous_end_ns, const CoreGaps& gaps) {
  if (is_event(r, task, *this)) {
    if (events.size() < kMaxEvents) {
      events.push_back(r);
    } else {
      ++events_left_out;
    }
  }
  if (jobs == 0) {
    first_release_ns = r.release_ns;
    first_k = r.k;
  }
  ++jobs;
  begun = true;
  last_release_ns = r.release_ns;
  last_k = r.k;
  last_end_ns = r.end_ns;
  last_cause = b.miss_cause;
  last_level = r.level;
  last_fault = r.fault;
  last_severity = r.severity;
  counts.add(r, b);
  lateness.record(r.lateness_ns());
  response.record(r.end_ns - r.release_ns);
  cpu.record(r.cpu_ns);
  slack.record(r.deadline_ns - r.end_ns);
  if (previous_end_ns <= r.release_ns) {
    if (const auto late = gaps.late_at(r.release_ns))
      late_minus_sentinel.record(r.lateness_ns() - *late);
  }
  if (r.level < kMaxLevels) {
    if (levels.size() <= r.level) levels.resize(std::size_t{r.level} + 1);
    LevelPast& level = levels[r.level];
    if (b.charged > 0) {
      ++level.charged;
    } else {
      ++level.jobs;
      level.cpu.record(r.cpu_ns);
    }
  }
  if (r.allocations != kNotCounted) allocations.record(std::int64_t{r.allocations});
  if (r.input_seq[0] > newest_input) {
    newest_input = r.input_seq[0];
    ++inputs_seen;
  }
}

void TaskPast::merge(const TaskPast& later) {
  if (later.jobs == 0) return;
  if (jobs == 0) {
    *this = later;
    return;
  }
  jobs += later.jobs;
  last_release_ns = later.last_release_ns;
  last_k = later.last_k;
  last_end_ns = later.last_end_ns;
  last_cause = later.last_cause;
  last_level = later.last_level;
  last_fault = later.last_fault;
  last_severity = later.last_severity;
  counts.merge(later.counts);
  lateness.merge(later.lateness);
  response.merge(later.response);
  cpu.merge(later.cpu);
  slack.merge(later.slack);
  late_minus_sentinel.merge(later.late_minus_sentinel);
  levels.resize(std::max(levels.size(), later.levels.size()));
  for (std::size_t i = 0; i < later.levels.size(); ++i) {
    levels[i].jobs += later.levels[i].jobs;
    levels[i].charged += later.levels[i].charged;
    levels[i].cpu.merge(later.levels[i].cpu);
  }
  allocations.merge(later.allocations);
  inputs_seen += later.inputs_seen;
  newest_input = std::max(newest_input, later.newest_input);
  const std::size_t room = kMaxEvents - std::min(kMaxEvents, events.size());
  const std::size_t taken = std::min(room, later.events.size());
  events.insert(events.end(), later.events.begin(),
                later.events.begin() + static_cast<std::ptrdiff_t>(taken));
  events_left_out += later.events_left_out + (later.events.size() - taken);
}

TaskPast TaskPast::following() const {
  TaskPast next;
  next.begun = begun;
  next.last_level = last_level;
  next.last_fault = last_fault;
  next.last_severity = last_severity;
  next.newest_input = newest_input;
  return next;
}

void fold_jobs(TaskPast& past, BlameWalk& walk, const TaskLog& task,
               std::span<const JobRecord> jobs, const CoreGaps& gaps) {
  for (const JobRecord& r : jobs) {
    const std::int64_t previous_end = walk.previous_end;
    const JobBlame b = walk.next(r, task, gaps);
    past.add(r, task, b, previous_end, gaps);
  }
}

}  // namespace rt
