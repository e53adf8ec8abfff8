// The robot_io task as an executor sees it: one bus cycle a job, goal and mode in, state out.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/robot_graph.hpp"
#include "tasks/robot_io/lasting_faults.hpp"

namespace tasks {

class RobotIoNode final : public rt::TaskBody {
 public:
  RobotIoNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
              RobotCells& cells, LinkStatus& link);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void make_safe() noexcept override {
    bus_.make_safe();
    if (safety_ != nullptr) safety_->make_safe();
  }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override {
    return twin_cpu_ ? twin_cpu_() : 0;
  }
  [[nodiscard]] const RobotIoTask::In& in() const noexcept { return in_; }

 private:
  void log_estop(const rt::Tick&) noexcept;
  void log_bus(const rt::Tick&) noexcept;
  RobotIoTask task_;
  drivers::MotorBus& bus_;
  drivers::SafetyIo* safety_;  // null: the robot has no safety lines
  RobotCells& cells_;
  LinkStatus& link_;
  std::function<std::int64_t()> twin_cpu_;
  bool hash_;
  drivers::BusStatus sent_ = drivers::BusStatus::kOk;  // of the last job's setpoints
  drivers::BusDetail sent_detail_;
  LastingFaults lasting_;  // of the bus and motors, on the log
  ReaderLimits<TaskId::kRobotIo> limits_;
  std::uint64_t logged_refused_ = 0, logged_expired_ = 0;
  rt::Time logged_estop_{};
  ModeMsg mode_;
  Mode heard_ = Mode::kInit;  // the newest one, however old
  RobotIoTask::In in_;
  RobotIoTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
