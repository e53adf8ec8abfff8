// Looks for a camera that tracking has lost, and doubts a pose that has leapt.
//
// A lost camera is believed to be back when two frames in a row pass the strict gates: the first
// against what was seen last or against a keyframe (perception/relocalisation), the second from the
// pose that the first one gave; that one is then tracked like any other. A frame does one thing
// about it: one cast, or one keyframe.
//
// Frames: W world (= map), C camera. SI. Noexcept and without allocation after construction.
#pragma once

#include <cstdint>
#include <optional>

#include "perception/geometry/rgbd_frame.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/relocalisation/relocaliser.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/camera_tracking.hpp"
#include "tasks/fusion/fusion_config.hpp"

namespace tasks {

class CameraSearch {
 public:
  // What is known of a frame in which the camera is looked for.
  struct LostFrame {
    const perception::RgbdFrame& frame;
    const perception::MotionPrior& prior;
    const FusionLevel& knobs;
    perception::ModelView model;  // what was seen last, or found
    Pose X_last_WC;               // of the frame before
    bool has_odometry = false;    // the prior is carried on by odometry
  };

  // Keeps references to `config` and `tracking`, whose prepared image all calls are about.
  CameraSearch(rt::NonRealtime&, const FusionConfig& config, const perception::Intrinsics& camera,
               CameraTracking& tracking);

  // The camera is lost: the search begins anew.
  void begin() noexcept;
  // Nobody knows where the camera is.
  [[nodiscard]] bool lost() const noexcept { return lost_; }
  // The last frame was found, and the next one is to agree.
  [[nodiscard]] bool confirming() const noexcept { return confirming_; }

  // Looks for the frame. Found and confirmed: r is tracked and claimed, and lost() is false.
  void recover(perception::TsdfMap& map, const LostFrame& f,
               perception::TrackingResult& r) noexcept;
  // Calls r lost where it is far from the prior and another place looks like what is seen.
  void doubt_leap(const perception::RgbdFrame& frame, const perception::MotionPrior& prior,
                  perception::TrackingResult& r) noexcept;
  // After each frame: is the camera lost from now on?
  void watch_for_loss(const perception::TrackingResult& r) noexcept;

  // Keeps the prepared image, taken at X_WC, as a view to find the camera by.
  void remember(const perception::RgbdFrame& frame, const Pose& X_WC) noexcept;
  [[nodiscard]] perception::Keyframes& keyframes() noexcept { return relocaliser_.keyframes(); }
  [[nodiscard]] const perception::Keyframes& keyframes() const noexcept {
    return relocaliser_.keyframes();
  }
  [[nodiscard]] std::uint64_t take_work() noexcept { return relocaliser_.take_work(); }

 private:
  [[nodiscard]] bool confirmed(const LostFrame& f, bool was_confirming,
                               perception::TrackingResult& r) noexcept;
  [[nodiscard]] bool moved_on(const LostFrame& f) const noexcept;
  [[nodiscard]] bool look(perception::TsdfMap& map, const Pose& X_WC) noexcept;

  const FusionConfig& config_;
  CameraTracking& tracking_;
  perception::Relocaliser relocaliser_;
  bool lost_ = false, confirming_ = false;
  bool look_again_ = false;  // what is to be seen from X_lost_WC_ was not all in the pool yet
  int blank_run_ = 0, adrift_run_ = 0;  // frames
  Pose X_lost_WC_ = Pose::Identity();   // where to look; confirming: if it is not confirmed
  // From where the map was looked at last, whether it is to be seen there or not.
  std::optional<Pose> X_looked_WC_;
};

}  // namespace tasks
