// Tracks the camera against the map, by what stands still, and says which pixels show what moves.
//
// One image: prepare(), then clear_mask() and track(). The pose follows from perception/icp; what
// moves is found first (perception/motion) and takes no part in the fit. When the fit and the
// majority of the image disagree, the image is aligned again without what does not fit.
//
// Frames: W world (= map), C camera. SI. Noexcept and without allocation after construction.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "perception/geometry/image.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/motion/motion_mask.hpp"
#include "perception/tsdf/blocks/map_view.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/fusion/fusion_config.hpp"

namespace perception {
class MotionWatch;
}

namespace tasks {

class CameraTracking {
 public:
  // Keeps a reference to `config`.
  CameraTracking(rt::NonRealtime&, const FusionConfig& config,
                 const perception::Intrinsics& camera);
  ~CameraTracking();

  void use(rt::ForkJoin& crew) noexcept { tracker_.use(crew); }
  // Filter, pyramid, normals of the next image.
  void prepare(const perception::ImageView<const std::uint16_t>& depth_mm,
               int pixel_step) noexcept {
    tracker_.prepare(depth_mm, camera_, pixel_step);
  }
  // Has the prepared image too few readings to track?
  [[nodiscard]] bool blank() const noexcept {
    return pyramid().level(1).valid < tracker_.least_points();
  }
  // Nothing has been seen to move in this image yet.
  void clear_mask() noexcept;
  // Estimates the camera's pose against `model`, a cast of `map`: r. What moves: m, and mask().
  void track(const perception::MapView& map, const perception::ModelView& model,
             const perception::MotionPrior& prior, const FusionLevel& knobs,
             perception::TrackingResult& r, perception::MotionResult& m) noexcept;

  // Does what the hand touches move, by the newest image, taken at X_WC?
  [[nodiscard]] bool touched_moves(const HapticState& hand, const Pose& X_WC) const noexcept;

  [[nodiscard]] const perception::TrackingPyramid& pyramid() const noexcept {
    return tracker_.pyramid();
  }
  [[nodiscard]] perception::Tracker& tracker() noexcept { return tracker_; }
  [[nodiscard]] perception::MotionWatch& watch() noexcept { return *watch_; }
  // Of the last image, a value of perception::PixelOf a pixel of the camera.
  [[nodiscard]] perception::ImageView<const std::uint8_t> mask() const noexcept {
    return {mask_.data(), camera_.width, camera_.height, camera_.width};
  }
  [[nodiscard]] perception::ImageView<std::uint8_t> mask() noexcept {
    return {mask_.data(), camera_.width, camera_.height, camera_.width};
  }
  // Is there a pixel in mask() that shows what moves?
  [[nodiscard]] bool masked() const noexcept { return masked_; }

 private:
  struct Job;  // one track()
  void align(Job& job, const Pose& X_WC_start) noexcept;
  void look_again(Job& job) noexcept;
  void find_movers(Job& job) noexcept;
  void align_by_what_stands(Job& job, bool by_majority) noexcept;
  [[nodiscard]] bool carried(const Job& job) noexcept;
  void align_without_misfits(Job& job, bool lost, bool by_majority) noexcept;
  void align_without_strangers(Job& job) noexcept;

  const FusionConfig& config_;
  perception::Intrinsics camera_;
  perception::Tracker tracker_;
  std::unique_ptr<perception::MotionWatch> watch_;
  std::vector<std::uint8_t> mask_;  // of perception::PixelOf
  bool masked_ = false;             // not all of it is kPlace
};

}  // namespace tasks
