// What every tool does that hands the fusion task the images of a sequence one by one, and how far
// off its claimed poses are.
#pragma once

#include <cstdint>
#include <memory>

#include "perception/geometry/rgbd_frame.hpp"
#include "tasks/fusion/fusion_task.hpp"

namespace teletact {

// Job k has image k, at the instant of its exposure. Makes patch and cost map, no view.
class FusionFeed {
 public:
  explicit FusionFeed(tasks::FusionTask& task);

  // The image of the next step, to be filled with its exposure before it.
  [[nodiscard]] perception::RgbdFrame& frame() noexcept { return *frame_; }
  // What goes in beside the image (hand, odometry); stays from step to step.
  tasks::FusionTask::In in;
  const tasks::FusionTask::Out& step() noexcept { return step(patch_.get()); }
  // The window goes there; nullptr: none is made.
  const tasks::FusionTask::Out& step(perception::SurfacePatch* window) noexcept;
  // A period without an image: the window at in.hand of the map as it is, at the instant of the
  // last step.
  void look(perception::SurfacePatch& window) noexcept;
  [[nodiscard]] const tasks::FusionTask::Out& out() const noexcept { return out_; }
  [[nodiscard]] const perception::CostMap& cost_map() const noexcept { return *cost_map_; }
  [[nodiscard]] double cpu_ms() const noexcept { return cpu_ms_; }  // thread CPU of the last step

 private:
  const tasks::FusionTask::Out& run(bool fresh, perception::SurfacePatch* window,
                                    perception::CostMap* cost_map) noexcept;
  tasks::FusionTask& task_;
  std::unique_ptr<perception::RgbdFrame> frame_;
  std::unique_ptr<perception::SurfacePatch> patch_;
  std::unique_ptr<perception::CostMap> cost_map_;
  tasks::FusionTask::Out out_;
  std::uint64_t k_ = 0;
  double cpu_ms_ = 0;
};

// Distance of claimed camera positions from the truth, the first claimed pose aligned.
class ClaimedError {
 public:
  // How far off this one is, m.
  double add(const perception::Pose& X_WC, const perception::Pose& truth_WC) noexcept;
  // RMS and largest; NaN when nothing was added.
  [[nodiscard]] double ate_mm() const noexcept;
  [[nodiscard]] double worst_mm() const noexcept;

 private:
  perception::Pose X_TW_ = perception::Pose::Identity();  // map to truth
  int count_ = 0;
  double squares_m2_ = 0, worst_m_ = 0;
};

}  // namespace teletact
