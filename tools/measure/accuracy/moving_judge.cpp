#include "tools/measure/accuracy/moving_judge.hpp"

#include <algorithm>
#include <cmath>

#include "perception/motion/motion_mask.hpp"
#include "tools/measure/accuracy/moving_film.hpp"

namespace teletact {

namespace {
constexpr double kAgainBelow = 0.30;  // share
}

void PoseJudge::add(int frame, bool claimed, const perception::Pose& X_TC,
                    const perception::Pose& truth_WC, double share) {
  ++frames_;
  if (claimed && !aligned_) {
    X_WT_ = truth_WC * X_TC.inverse(Eigen::Isometry);
    aligned_ = true;
  }
  off_mm_ = 1e3 * ((X_WT_ * X_TC).translation() - truth_WC.translation()).norm();
  if (claimed) {
    error_.add(X_TC, truth_WC);
    ++claimed_;
    // A pose that is no number is wrong.
    if (!(off_mm_ <= limit_mm_) && wrong_++ == 0) first_wrong_ = frame;
  }
  if (share >= kAgainBelow) {
    was_above_ = true, waiting_ = -1;
  } else if (was_above_) {
    was_above_ = false, waiting_ = 0;
  }
  if (waiting_ < 0) return;
  again_ = std::isnan(again_) ? waiting_ : std::max(again_, static_cast<double>(waiting_));
  waiting_ = claimed ? -1 : waiting_ + 1;
}

void PoseJudge::write(MovingRun& run) const {
  run.ate_mm = error_.ate_mm(), run.worst_mm = error_.worst_mm();
  run.claimed = static_cast<double>(claimed_) / std::max(1, frames_);
  run.wrong = wrong_, run.first_wrong = first_wrong_;
  run.claimed_again = again_;
}

MaskFigures judge_mask(std::span<const std::uint8_t> mask, std::span<const std::uint8_t> truth) {
  MaskFigures figures;
  int both = 0, any = 0, moving = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const auto t = static_cast<PixelTruth>(truth[i] & kTruthMask);
    const bool masked = mask[i] != static_cast<std::uint8_t>(perception::PixelOf::kPlace);
    if (t == PixelTruth::kEither) continue;
    const bool moves = t == PixelTruth::kMoving;
    both += moves && masked ? 1 : 0;
    any += moves || masked ? 1 : 0;
    moving += moves ? 1 : 0;
    figures.still += moves ? 0 : 1;
    figures.still_hit += !moves && masked ? 1 : 0;
  }
  if (moving > kJudgedShare * static_cast<double>(truth.size()))
    figures.iou = static_cast<double>(both) / any;
  if (figures.still > 0) {
    figures.still_masked = static_cast<double>(figures.still_hit) / figures.still;
  }
  return figures;
}

}  // namespace teletact
