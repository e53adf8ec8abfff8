// The robot box's tasks as executors see them.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/robot_graph.hpp"

namespace tasks {

class RobotIoNode final : public rt::TaskBody {
 public:
  RobotIoNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
              RobotCells& cells, LinkStatus& link);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void make_safe() noexcept override { bus_.make_safe(); }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override {
    return twin_cpu_ ? twin_cpu_() : 0;
  }
  [[nodiscard]] const RobotIoTask::In& in() const noexcept { return in_; }

 private:
  RobotIoTask task_;
  drivers::MotorBus& bus_;
  RobotCells& cells_;
  LinkStatus& link_;
  std::function<std::int64_t()> twin_cpu_;
  bool hash_;
  drivers::MotorSetpoints setpoints_;  // of the last committed job: goes out with the next exchange
  LimitWatch goal_in_, mode_in_;
  std::uint64_t logged_refused_ = 0, logged_expired_ = 0;
  ModeMsg mode_;
  Mode heard_ = Mode::kInit;  // the newest one, however old
  RobotIoTask::In in_;
  RobotIoTask::Out out_;
  rt::Health health_;
};

class CaptureNode final : public rt::TaskBody {
 public:
  CaptureNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
              RobotCells& cells);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override {
    return twin_cpu_ ? twin_cpu_() : 0;
  }

 private:
  CaptureTask task_;
  drivers::Camera& camera_;
  RobotCells& cells_;
  std::function<std::int64_t()> twin_cpu_;
  bool hash_;
  int logged_level_ = -1;
  std::unique_ptr<perception::RgbdFrame> frame_;
  CaptureTask::In in_;
  CaptureTask::Out out_;
  rt::Health health_;
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
  EdgeGate mode_gate_;
  LimitWatch goal_in_;
  Mode logged_mode_ = Mode::kInit;
  SupervisionTask::In in_;
  SupervisionTask::Out out_;
};

}  // namespace tasks
