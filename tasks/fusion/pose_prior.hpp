// Where the camera should be at an instant, before the image is looked at: by odometry where it is
// known over the whole interval, else by the velocity of the last frames.
//
// Frames: W world, C camera, B robot base, O odometry. SI.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "perception/icp/tracker.hpp"
#include "rt/time.hpp"
#include "tasks/fusion/fusion_config.hpp"
#include "tasks/fusion/fusion_io.hpp"
#include "tasks/fusion/fusion_parts.hpp"
#include "tasks/fusion/odometry_chain.hpp"

namespace tasks {

// The last samples of odometry.
class OdometryLog {
 public:
  // Keeps a sample that is newer than the last one and finite.
  void remember(const std::optional<OdometryPrior>& odometry) noexcept;
  // Interpolated; beyond the newest sample by its velocity, at most 100 ms. Empty: not known then.
  [[nodiscard]] std::optional<Pose> X_OB_at(rt::Time t) const noexcept;

 private:
  static constexpr std::size_t kSamples = 16;
  std::array<OdometryPrior, kSamples> samples_{};  // ring, newest at count_ - 1
  std::uint64_t count_ = 0;
};

class PosePredictor {
 public:
  // What is known of a frame's motion when its pose is settled.
  struct Settled {
    bool first = false;    // the frame that defines the map
    bool certain = false;  // no other motion explains the image
    bool lost = false;     // the camera is being looked for
  };

  PosePredictor(const FusionConfig& config, const Pose& X_BC) : config_(config), X_BC_(X_BC) {}

  void remember(const std::optional<OdometryPrior>& odometry) noexcept { log_.remember(odometry); }
  // Where the camera should be at `exposure`, by what was believed at the last frame. Also advances
  // what odometry knows to that instant.
  [[nodiscard]] perception::MotionPrior predict(const CameraState& last,
                                                rt::Time exposure) noexcept;
  // The frame of `exposure` has the camera at r.X_WC; `last` as it was before this frame.
  void settle(const CameraState& last, const perception::TrackingResult& r, rt::Time exposure,
              Settled how) noexcept;
  // Does odometry carry the camera at the last frame?
  [[nodiscard]] bool has_odometry() const noexcept { return X_OB_last_.has_value(); }

 private:
  const FusionConfig& config_;
  Pose X_BC_;
  OdometryLog log_;
  std::optional<Pose> X_OB_last_;  // at the last frame
  // Error of odometry since the scene last constrained everything.
  double sigma_translation_m_ = 0, sigma_rotation_deg_ = 0;
  OdometryChain chain_;
  Eigen::Matrix<double, 6, 1> velocity_ = Eigen::Matrix<double, 6, 1>::Zero();  // of C, in C, per s
};

}  // namespace tasks
