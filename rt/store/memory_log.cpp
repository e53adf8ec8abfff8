#include "rt/store/memory_log.hpp"

#include <algorithm>
#include <utility>

namespace rt {

void MemoryLog::add(const JobRecord& record) {
  TaskLog* task = log_.find(record.task);
  if (task == nullptr) return;
  task->jobs.push_back(record);
  if (++held_ > most_) fold();
}

void MemoryLog::fold() {
  std::vector<std::vector<JobRecord>> older;
  for (TaskLog& t : log_.tasks) {
    const auto middle = t.jobs.begin() + static_cast<std::ptrdiff_t>(t.jobs.size() / 2);
    older.emplace_back(t.jobs.begin(), middle);
    t.jobs.erase(t.jobs.begin(), middle);
    held_ -= older.back().size();
  }
  Part part = folder_.fold(older, {}, log_.sentinels);
  for (auto& [id, past] : part.tasks) {
    TaskLog* task = log_.find(id);
    TaskPast sum = task->past ? *task->past : TaskPast{};
    sum.merge(past);
    task->past = std::make_shared<const TaskPast>(std::move(sum));
  }
}

}  // namespace rt
