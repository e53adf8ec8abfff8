// The prediction task as an executor sees it: latch robot state, path and camera, step, commit goal
// and odometry frame.
#pragma once

#include "tasks/graph/limits.hpp"
#include "tasks/graph/operator_graph.hpp"

namespace tasks {

class PredictionNode final : public rt::TaskBody {
 public:
  PredictionNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
                 OperatorCells& cells, LinkStatus& link);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  [[nodiscard]] const PredictionTask::In& in() const noexcept { return in_; }

  // The newest that the newest latch found, held or not. `any` false: none yet.
  struct LatchedDrive {
    bool any = false;
    std::uint64_t number = 0;
    rt::Time at{};
  };
  [[nodiscard]] const DriveIntent& drive() const noexcept { return drive_; }
  [[nodiscard]] const LatchedDrive& drive_latched() const noexcept { return drive_latched_; }

 private:
  PredictionTask task_;
  OperatorCells& cells_;
  LinkStatus& link_;
  bool hash_;
  ReaderLimits<TaskId::kPrediction> limits_;
  ModeMsg mode_;
  DriveIntent drive_;
  LatchedDrive drive_latched_;
  bool mode_live_ = true, path_live_ = true;
  PredictionTask::In in_;
  PredictionTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
