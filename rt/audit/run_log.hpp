// Everything the audit keeps of a run: the records of every task and sentinel sample, in order.
// Filled by the drain thread (real clock) or the simulation (virtual clock); read after the run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rt/audit/job_record.hpp"
#include "rt/sched/task_spec.hpp"

namespace rt {

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
};

struct RunLog {
  std::vector<TaskLog> tasks;             // by position in the task table
  std::vector<SentinelRecord> sentinels;  // in order of release, all cores mixed
  std::uint64_t dropped = 0;              // job and sentinel records lost because a ring was full
  std::vector<std::string> not_realtime;  // what the machine refused; empty = a real-time run

  [[nodiscard]] TaskLog* find(std::uint16_t id) noexcept {
    for (auto& t : tasks) {
      if (t.id == id) return &t;
    }
    return nullptr;
  }
};

}  // namespace rt
