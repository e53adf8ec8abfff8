// How the camera has moved against what stands still: the consensus of the image's cells
// (consensus.hpp), asked about the prior first, and about competing hypotheses where the prior
// leaves much of the image unexplained.
//
// Frames: W world, C camera, F the camera that `model` was cast from. Noexcept, no allocation after
// construction.
#pragma once

#include <array>
#include <cstdint>

#include "perception/icp/tracker.hpp"
#include "perception/motion/consensus.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/motion/watched_image.hpp"

namespace perception::motion {

class StillMotion {
 public:
  // Keeps references.
  StillMotion(const MotionConfig& config, const TrackerConfig& tracker, const WatchedImage& image);

  // Another map, or a camera that was elsewhere.
  void forget() noexcept;
  // An image comes of which nothing is known yet.
  void begin(const Pose& X_prior_WC) noexcept;
  // Does the prior, mended, explain the image? If not, out.doubtful: compete() has to follow.
  // cells() say which of them may stand still.
  void look(const TrackingPyramid& pyramid, const ModelView& model, const MotionPrior& prior,
            MotionResult& out) noexcept;
  // Hypotheses, about the prior or about where the whole image would have the camera,
  // `X_tracked_WC`.
  void compete(const TrackingPyramid& pyramid, const ModelView& model, const MotionPrior& prior,
               const Pose& X_tracked_WC, MotionResult& out) noexcept;
  // Of what the pose by what stands still explains of the image: the share that another pose does.
  [[nodiscard]] double explains(const TrackingPyramid& pyramid, const ModelView& model,
                                const Pose& X_WC) noexcept;
  // A claimed pose.
  void settle(const TrackingResult& r) noexcept;

  // Of each cell, before look(): the share that may be static.
  [[nodiscard]] Consensus::Cells& cells() noexcept { return memory_; }
  [[nodiscard]] const Consensus& consensus() const noexcept { return consensus_; }
  [[nodiscard]] bool looked() const noexcept { return looked_; }
  // The prior left much of the image unexplained.
  [[nodiscard]] bool doubtful() const noexcept { return doubtful_; }
  // No other motion explains the image as well.
  [[nodiscard]] bool certain() const noexcept { return certain_; }
  void doubt() noexcept { certain_ = false; }
  // Of the readings that were looked at: how many meet a surface of the map at all.
  [[nodiscard]] double met_share() const noexcept;

 private:
  [[nodiscard]] std::uint64_t pixels() const noexcept {
    return static_cast<std::uint64_t>(image_.width) * static_cast<std::uint64_t>(image_.height);
  }
  void linearise(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                 bool again = false) noexcept;
  bool settle_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                 MotionResult& out) noexcept;
  void stay_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
               MotionResult& out) noexcept;
  void let_odometry_choose(const TrackingPyramid& pyramid, const ModelView& model,
                           const MotionPrior& prior, bool competed, MotionResult& out) noexcept;
  [[nodiscard]] bool loose(float scale) const noexcept;
  double choose_start(const TrackingPyramid& pyramid, const ModelView& model,
                      const Pose& X_expected_WC, const Pose& X_tracked_WC,
                      MotionResult& out) noexcept;
  // Does the image say something else than odometry that is good enough to claim on?
  [[nodiscard]] bool against_odometry(const MotionPrior& prior,
                                      const MotionResult& r) const noexcept;
  [[nodiscard]] double prior_sigma_m() const noexcept;
  [[nodiscard]] Pose moved_by(const Vec6& xi) const noexcept;
  [[nodiscard]] Vec6 twist_to(const Pose& X_WC) const noexcept;

  const MotionConfig& config_;
  const TrackerConfig& tracker_;
  const WatchedImage& image_;
  Consensus consensus_;
  ConsensusConfig rule_;
  Pose X_WF_ = Pose::Identity(), X_FC_ = Pose::Identity();  // where the sums were taken
  Vec3 centre_F_ = Vec3::Zero();
  Pose X_prior_WC_ = Pose::Identity(), X_majority_WC_ = Pose::Identity();
  std::array<Consensus::Stand, 3> stand_{};  // of the poses that choose_start() compares
  Consensus::Cells memory_{};                // 0: moved in the last image
  bool looked_ = false;                      // the consensus is of this image
  bool doubtful_ = false;
  bool held_ = false;                 // its pose is believed against what explains more
  bool certain_ = false;              // and no other motion explains it as well
  double innovation_m_ = 0.02;        // mean way of the tracked poses from their priors, of late
  float scale_ = 1, late_scale_ = 1;  // by which the cells fit: in the last image, of late
};

}  // namespace perception::motion
