// Claims and masks of a run against the truth.
#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "perception/geometry/pose.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {

struct MovingRun {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  static constexpr int kNever = 999;  // frames
  double ate_mm = kNone, worst_mm = kNone;
  double claimed = 0;  // share of the frames
  int wrong = 0,
      first_wrong = -1;  // claims off by more than 20 mm up to a share of .30, 50 mm above
  // Frames from the share's fall below .30 to a claim, the largest; kNone: it never was above.
  double claimed_again = kNone;
  double mask_iou = kNone;  // median over the claimed frames in which enough moves (kJudgedShare)
  double masked_still = 0, masked_still_p95 = 0;  // share of the still pixels
  double ghost_cm3 = kNone;                       // the largest of the checks
  double ghost_cells = kNone;                     // occupied cells of the cost map where nothing is
  double ghost_nodes = kNone;                     // solid nodes of a hand's window where nothing is
  double rest_frames = kNone;  // from at rest to in the mesh; kNone: not to be judged
  double rest_cost = kNone;    // share of it in the cost map 20 frames after it has come to rest
  std::size_t vertices = 0;
  double cpu_ms = 0, cpu_most_ms = 0;  // of a frame, mean and largest
};

// Error of a claimed camera position above which it is wrong, by the largest share of the run.
[[nodiscard]] inline double wrong_above_mm(double share) { return share <= 0.30 ? 20 : 50; }

// The poses of a run, aligned by the first that was claimed.
class PoseJudge {
 public:
  explicit PoseJudge(double share_most) : limit_mm_(wrong_above_mm(share_most)) {}
  // T: the world of what is judged; `share`: of the mover in this frame.
  void add(int frame, bool claimed, const perception::Pose& X_TC, const perception::Pose& truth_WC,
           double share);
  void write(MovingRun& run) const;
  [[nodiscard]] const perception::Pose& X_WT() const { return X_WT_; }
  [[nodiscard]] double off_mm() const { return off_mm_; }  // of the last frame, claimed or not
  [[nodiscard]] double off_mm(const perception::Pose& X_TC,
                              const perception::Pose& truth_WC) const {
    return 1e3 * ((X_WT_ * X_TC).translation() - truth_WC.translation()).norm();
  }

 private:
  double limit_mm_;
  ClaimedError error_;
  perception::Pose X_WT_ = perception::Pose::Identity();
  bool aligned_ = false, was_above_ = false;
  int frames_ = 0, claimed_ = 0, wrong_ = 0, first_wrong_ = -1;
  int waiting_ = -1;  // frames since the share fell, without a claim; -1: not waiting
  double again_ = MovingRun::kNone, off_mm_ = 0;
};

// Intersection over union of mask and moving pixels; what is either counts in neither.
inline constexpr double kJudgedShare = 0.0025;
struct MaskFigures {
  double iou = MovingRun::kNone;  // NaN: fewer than kJudgedShare of the pixels move
  double still_masked = 0;        // share of the still pixels
  int still = 0, still_hit = 0;
};
// `mask`: perception::PixelOf; `truth`: a byte a pixel as in MovingFilm.
[[nodiscard]] MaskFigures judge_mask(std::span<const std::uint8_t> mask,
                                     std::span<const std::uint8_t> truth);

}  // namespace teletact
