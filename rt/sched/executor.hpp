// One interface, two clocks: the same TaskBody objects run on pinned SCHED_FIFO threads
// (real_executor.hpp) or in a preemptive fixed-priority discrete-event simulation
// (virtual_executor.hpp).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "rt/sched/job_record.hpp"
#include "rt/sched/task.hpp"

namespace rt {

struct RunPlan {
  std::int64_t epoch_host_ns = 0;  // common epoch of both boxes, host clock
  Nanos duration{0};               // releases at or after epoch + duration are not served
  BoxTime clock[2];                // of the operator box and the robot box
  Nanos hyperperiod{100000000};    // variant switches happen at its multiples
};

class Executor {
 public:
  virtual ~Executor() = default;
  // Runs until the duration is over or a stop was requested. Every job's record goes to the sink,
  // in completion order (virtual) or per-task order (real).
  virtual void run(const RunPlan& plan) = 0;
  virtual void request_stop() noexcept = 0;
  // By position in the vector of tasks; after run().
  [[nodiscard]] virtual std::vector<TaskTotals> totals() const = 0;
};

}  // namespace rt
