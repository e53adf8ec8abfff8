// The supervision of each box as an executor sees it: latch health of the watched tasks, the link,
// what is asked; commit the mode.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/robot_graph.hpp"

namespace tasks {

// What `in` took from the shared words of link and operator.
[[nodiscard]] LatchedStatus latched_status(const SupervisionTask::In& in) noexcept;

class SupervisionNode final : public rt::TaskBody {
 public:
  SupervisionNode(rt::NonRealtime& nrt, const GraphConfig& config, OperatorCells& cells,
                  LinkStatus& link, OperatorRequests& requests, const OperatorSetup& setup);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  [[nodiscard]] const SupervisionTask::In& in() const noexcept { return in_; }

 private:
  SupervisionTask task_;
  OperatorCells& cells_;
  LinkStatus& link_;
  OperatorRequests& requests_;
  bool hash_;
  Mode logged_mode_ = Mode::kInit;
  ReaderLimits<TaskId::kSupervision> limits_;
  SupervisionTask::In in_;
  SupervisionTask::Out out_;
};

class RobotSupervisionNode final : public rt::TaskBody {
 public:
  RobotSupervisionNode(rt::NonRealtime& nrt, const GraphConfig& config, RobotCells& cells,
                       LinkStatus& link, OperatorRequests& requests, const RobotSetup& setup);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  [[nodiscard]] const SupervisionTask::In& in() const noexcept { return in_; }

 private:
  SupervisionTask task_;
  RobotCells& cells_;
  LinkStatus& link_;
  OperatorRequests& requests_;
  bool hash_;
  bool estop_fitted_;
  ReaderLimits<TaskId::kRobotSupervision> limits_;
  std::uint64_t goals_session_ = 0;  // connection, since which void_goal_ is the last one's
  rt::Time void_goal_{};             // when it was made
  Mode logged_mode_ = Mode::kInit;
  SupervisionTask::In in_;
  SupervisionTask::Out out_;
};

}  // namespace tasks
