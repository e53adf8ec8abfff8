// The fusion task as an executor sees it: latch image, hand, odometry and edits, step, commit map
// window, views and pose.
#pragma once

#include "tasks/fusion/drawn_obstacles.hpp"
#include "tasks/fusion/given_boxes.hpp"
#include "tasks/graph/limits.hpp"
#include "tasks/graph/operator_graph.hpp"

namespace tasks {

class FusionNode final : public rt::TaskBody {
 public:
  // Throws std::runtime_error where config.fusion.map can not be loaded.
  FusionNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
             OperatorCells& cells, const OperatorRequests& requests);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void use(rt::ForkJoin& crew) noexcept override { task_->use(crew); }
  [[nodiscard]] const FusionTask& task() const noexcept { return *task_; }
  [[nodiscard]] const FusionTask::In& in() const noexcept { return in_; }
  // That the newest latch took.
  [[nodiscard]] const std::optional<SceneEdit>& edit() const noexcept { return edit_; }

 private:
  void take_edit(rt::Time now) noexcept;
  [[nodiscard]] bool apply(const SceneEdit& edit) noexcept;
  void end_step(const rt::Tick& tick, rt::JobRecord& record) noexcept;
  std::unique_ptr<FusionTask> task_;
  OperatorCells& cells_;
  const OperatorRequests& requests_;
  DrawnObstacles drawn_;
  GivenBoxes given_;
  std::optional<SceneEdit> edit_;
  bool edit_refused_ = false;
  bool hash_, odometry_prior_, lost_ = false;
  int logged_level_ = -1;
  ReaderLimits<TaskId::kFusion> limits_;
  std::uint64_t frame_seq_ = 0;
  FusionTask::In in_;
  FusionTask::Out out_;
  rt::Health health_;
};

}  // namespace tasks
