#include "rt/store/part.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

namespace rt {

void Part::add(StoreEvent event) {
  if (events.size() < kMaxEvents) {
    event.text.resize(std::min(event.text.size(), StoreEvent::kMaxText));
    events.push_back(std::move(event));
  } else {
    ++events_left_out;
  }
}

void Part::merge(Part&& later) {
  last = later.last;
  if (from_ns == 0 && to_ns == 0) from_ns = later.from_ns;
  if (later.from_ns != 0 || later.to_ns != 0) to_ns = later.to_ns;
  for (auto& [id, past] : later.tasks) tasks[id].merge(past);
  for (auto& [core, histogram] : later.sentinels) sentinels[core].merge(histogram);
  for (auto& event : later.events) add(std::move(event));
  events_left_out += later.events_left_out;
}

Folder::Folder(const RunLog& header) {
  for (const TaskLog& t : header.tasks) {
    rows_.emplace_back();
    rows_.back().task = t;
    rows_.back().task.jobs.clear();
    rows_.back().task.past.reset();
  }
}

Part Folder::fold(const std::vector<std::vector<JobRecord>>& jobs,
                  std::span<const SentinelRecord> own, std::span<const SentinelRecord> around) {
  Part part;
  std::map<int, CoreGaps> gaps;
  for (std::size_t i = 0; i < rows_.size() && i < jobs.size(); ++i) {
    if (jobs[i].empty()) continue;
    Row& row = rows_[i];
    const auto core = gaps.try_emplace(row.task.core, around, row.task.core).first;
    TaskPast& past = part.tasks[row.task.id] = row.before.following();
    fold_jobs(past, row.walk, row.task, jobs[i], core->second);
    row.before = past.following();
    if (part.from_ns == 0 && part.to_ns == 0) {
      part.from_ns = past.first_release_ns;
      part.to_ns = past.last_release_ns;
    }
    part.from_ns = std::min(part.from_ns, past.first_release_ns);
    part.to_ns = std::max(part.to_ns, past.last_release_ns);
  }
  for (const SentinelRecord& s : own) part.sentinels[s.core].record(s.late_ns);
  return part;
}

}  // namespace rt
