// Everything the audit keeps of a run: the records of every task and sentinel sample, in order.
// Filled by the drain thread (real clock) or the simulation (virtual clock); read after the run.
// Of a long run the oldest records are gone: TaskPast has their counts and histograms.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rt/audit/histogram.hpp"
#include "rt/sched/job_record.hpp"
#include "rt/sched/task_spec.hpp"

namespace rt {

struct TaskPast;  // task_past.hpp

struct TaskLog {
  TaskSpec spec;
  std::uint16_t id = 0;
  int core = 0, priority = 0, level = 0;
  std::vector<JobRecord> jobs;  // in order of k
  // Range of the deterministic work count seen by calibration; {0, 0} = not calibrated.
  std::uint64_t work_min = 0, work_max = 0;
  // What the executor counted; empty if the run did not reach its end. Counts more than the records
  // tell: releases dropped after the last one, and jobs whose record was lost.
  std::optional<TaskTotals> totals;
  // What is kept of the jobs before `jobs`, whose records are gone; null: nothing went.
  std::shared_ptr<const TaskPast> past;
};

struct RunLog {
  std::vector<TaskLog> tasks;               // by position in the task table
  std::vector<SentinelRecord> sentinels;    // in order of release, all cores mixed
  std::uint64_t dropped = 0;                // job and sentinel records lost because a ring was full
  std::vector<std::string> not_realtime;    // what the machine refused; empty = a real-time run
  std::int64_t epoch_ns = 0;                // box clock; 0: not known
  std::map<int, Histogram> past_sentinels;  // by core: lateness of those before `sentinels`
  std::vector<std::string> told;  // what a reader of it should know: thinned, damaged, a part only

  [[nodiscard]] TaskLog* find(std::uint16_t id) noexcept {
    for (auto& t : tasks) {
      if (t.id == id) return &t;
    }
    return nullptr;
  }
};

}  // namespace rt
