// A task as an executor sees it: a spec and a body. One job is latch -> step -> commit on one
// thread.
#pragma once

#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/sched/fork_join.hpp"
#include "rt/sched/job_record.hpp"
#include "rt/sched/task_spec.hpp"

namespace rt {

class TaskBody {
 public:
  virtual ~TaskBody() = default;

  // Sense: read the device and take the newest input of every port. Records the sequence numbers.
  virtual void latch(const Tick& tick, JobRecord& record) noexcept = 0;
  // Pure: works on what latch() took, writes only into this task's own outputs.
  // Sets record.work. Called inside a real-time Section.
  virtual Health step(const Tick& tick, JobRecord& record) noexcept = 0;
  // Publish the outputs and act on the device. Not called for an aborted job.
  virtual void commit(const Tick& tick, JobRecord& record) noexcept = 0;
  // Called instead of commit() for an aborted job that had started: take back what latch() and
  // step() changed, so that the next job sees the same state and the same unread events.
  virtual void abandon(const Tick& /*tick*/) noexcept {}
  // Threads that take part in step(), where the task's row has workers. Before the first job.
  virtual void use(ForkJoin& /*crew*/) noexcept {}
  // The safe output, from any thread, even while step() hangs.
  virtual void make_safe() noexcept {}
  // Simulated devices inside latch() or commit(): their thread CPU so far, to be taken out.
  [[nodiscard]] virtual std::int64_t twin_cpu_ns() const noexcept { return 0; }
};

// A row of the table that an executor runs: spec, body and where admission placed it.
struct PlacedTask {
  TaskSpec spec;
  TaskBody* body = nullptr;  // of a pool worker's row: none, it does parts of its parent's
  std::uint16_t id = 0;      // row in the task table of the whole stack
  int core = 0;              // CPU number (real) or core index (virtual)
  int priority = 0;          // larger runs first; derived by rate_monotonic_order()
  int level = 0;             // variant in force at the start
  int last_level = -1;       // run-time degradation goes no further; -1: the smallest there is

  [[nodiscard]] int lowest_level() const noexcept {
    return last_level < 0 ? spec.levels() - 1 : last_level;
  }
};

}  // namespace rt
