// The planning task as an executor sees it: latch marks, map and where the base is, step, commit
// path and state.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/operator_graph.hpp"

namespace tasks {

class PlanningNode final : public rt::TaskBody {
 public:
  PlanningNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
               OperatorCells& cells, const OperatorRequests& requests);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void abandon(const rt::Tick& tick) noexcept override;
  [[nodiscard]] const PlanningTask::In& in() const noexcept { return in_; }

  // Taken off its ring by the newest latch.
  [[nodiscard]] const std::optional<OperatorAct>& act() const noexcept { return act_taken_; }

 private:
  void take_act(rt::Time now) noexcept;
  PlanningTask task_;
  OperatorCells& cells_;
  const OperatorRequests& requests_;
  bool hash_;
  int logged_level_ = -1;
  ReaderLimits<TaskId::kPlanning> limits_;
  rt::Time touch_heard_{};  // when events were last taken
  std::optional<OperatorAct> act_taken_;
  drivers::RobotState robot_;  // the newest, its pose in W
  PlanningTask::In in_;        // events stay here until a job that saw them has committed
  PlanningTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
