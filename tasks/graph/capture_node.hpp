// The capture task as an executor sees it: poll the camera, encode, commit the frame for the link.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/robot_graph.hpp"

namespace tasks {

class CaptureNode final : public rt::TaskBody {
 public:
  CaptureNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
              RobotCells& cells);
  // What the last latch took of the edge `demand`; number 0: nothing yet.
  [[nodiscard]] const LatchedDemand& latched() const noexcept { return latched_; }
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void abandon(const rt::Tick& tick) noexcept override;
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override {
    return twin_cpu_ ? twin_cpu_() : 0;
  }

  [[nodiscard]] const CaptureTask::In& in() const noexcept { return in_; }
  [[nodiscard]] const CaptureTask& task() const noexcept { return task_; }

 private:
  CaptureTask task_;
  drivers::Camera& camera_;
  RobotCells& cells_;
  std::function<std::int64_t()> twin_cpu_;
  bool hash_;
  int logged_level_ = -1;
  std::unique_ptr<perception::RgbdFrame> frame_;
  ReaderLimits<TaskId::kCapture> limits_;
  LatchedDemand latched_;
  CaptureTask::In in_;
  CaptureTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
