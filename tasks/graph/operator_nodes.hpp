// The operator box's tasks as executors see them: latch the ports, run the pure step, commit.
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
  EdgeGate touch_gate_, hand_gate_;
  bool touch_gap_ = false;  // an event did not fit: the next one says so
  LimitWatch patch_in_, surface_in_, mode_in_, camera_in_;
  HapticTask::In in_;
  HapticTask::Out out_;
  rt::Health health_;
};

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
  std::unique_ptr<FusionTask> task_;
  OperatorCells& cells_;
  const OperatorRequests& requests_;
  DrawnObstacles drawn_;
  std::optional<SceneEdit> edit_;
  bool edit_refused_ = false;
  bool hash_, odometry_prior_, lost_ = false;
  int logged_level_ = -1;
  EdgeGate patch_gate_, surface_gate_, view_gate_, mesh_gate_, map_gate_, camera_gate_,
      objects_gate_;
  LimitWatch frame_in_, hand_in_, robot_in_, edit_in_;
  std::uint64_t frame_seq_ = 0;
  FusionTask::In in_;
  FusionTask::Out out_;
  rt::Health health_;
};

class PlanningNode final : public rt::TaskBody {
 public:
  PlanningNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
               OperatorCells& cells);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void abandon(const rt::Tick& tick) noexcept override;
  [[nodiscard]] const PlanningTask::In& in() const noexcept { return in_; }

 private:
  PlanningTask task_;
  OperatorCells& cells_;
  bool hash_;
  EdgeGate path_gate_, task_gate_;
  int logged_level_ = -1;
  LimitWatch map_in_, robot_in_, objects_in_, touch_in_, mode_in_, frame_in_;
  rt::Time touch_heard_{};     // when events were last taken
  drivers::RobotState robot_;  // the newest, its pose in W
  PlanningTask::In in_;        // events stay here until a job that saw them has committed
  PlanningTask::Out out_;
  rt::Health health_;
};

class PredictionNode final : public rt::TaskBody {
 public:
  PredictionNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
                 OperatorCells& cells, LinkStatus& link);
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override;
  [[nodiscard]] const PredictionTask::In& in() const noexcept { return in_; }

 private:
  PredictionTask task_;
  OperatorCells& cells_;
  LinkStatus& link_;
  bool hash_;
  EdgeGate frame_gate_;
  LimitWatch robot_in_, path_in_, camera_in_, mode_in_;
  ModeMsg mode_;
  bool mode_live_ = true, path_live_ = true;
  PredictionTask::In in_;
  PredictionTask::Out out_;
  rt::Health health_;
};

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
  EdgeGate mode_gate_;
  Mode logged_mode_ = Mode::kInit;
  LimitWatch robot_in_;
  SupervisionTask::In in_;
  SupervisionTask::Out out_;
};

}  // namespace tasks
