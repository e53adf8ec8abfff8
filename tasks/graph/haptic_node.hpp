// The haptic task as an executor sees it: latch the hand and its inputs, step, commit the force and
// what the hand did.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/operator_graph.hpp"

namespace tasks {

class HapticNode final : public rt::TaskBody {
 public:
  HapticNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
             OperatorCells& cells, double period_s);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void make_safe() noexcept override { device_.make_safe(); }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override {
    return twin_cpu_ ? twin_cpu_() : 0;
  }
  [[nodiscard]] const HapticTask& task() const noexcept { return task_; }
  [[nodiscard]] const HapticTask::In& in() const noexcept { return in_; }

 private:
  void send(const rt::Tick& tick, const TouchEvent& event) noexcept;
  HapticTask task_;
  drivers::HapticDevice& device_;
  OperatorCells& cells_;
  std::function<std::int64_t()> twin_cpu_;
  bool hash_;
  bool touch_gap_ = false;  // an event did not fit: the next one says so
  ReaderLimits<TaskId::kHaptic> limits_;
  HapticTask::In in_;
  HapticTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
