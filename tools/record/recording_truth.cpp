#include "tools/record/recording_truth.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"
#include "tools/files/pose_file.hpp"

namespace teletact {

namespace {

drivers::TumSequence open_sequence(const std::string& dir) {
  auto sequence = drivers::TumSequence::open(dir);
  if (!sequence) throw std::runtime_error(sequence.error());
  return std::move(sequence).value();
}

std::vector<StampedPose> truth_of(const std::string& dir) {
  auto poses = read_truth(dir);
  if (!poses) throw std::runtime_error(poses.error());
  return std::move(poses).value();
}

}  // namespace

double recording_seconds(const std::string& dir) {
  const auto sequence = open_sequence(dir);
  static_cast<void>(truth_of(dir));  // a spoilt one is said before the run, not after it
  return sequence.size() < 2 ? 0.0 : sequence.stamp_s(sequence.size() - 1) - sequence.stamp_s(0);
}

TrackingFigures tracking_figures(const std::vector<tasks::FusionSample>& samples,
                                 const TruthAt& truth_WC) {
  TrackingFigures out;
  std::optional<perception::Pose> X_align;
  double sum_m2 = 0, worst_m2 = 0;
  std::size_t n = 0;
  for (const auto& s : samples) {
    if (!s.consumed) continue;
    ++out.frames;
    out.tracked += s.tracked ? 1 : 0;
    out.claimed += s.claimed ? 1 : 0;
    if (!s.claimed) continue;
    const auto X_true_WC = truth_WC(s.exposure);
    if (!X_true_WC) continue;
    perception::Pose X = perception::Pose::Identity();
    X.linear() = Eigen::Quaternionf(s.q_WC[3], s.q_WC[0], s.q_WC[1], s.q_WC[2])
                     .cast<double>()
                     .normalized()
                     .toRotationMatrix();
    X.translation() =
        perception::Vec3(static_cast<double>(s.p_WC[0]), static_cast<double>(s.p_WC[1]),
                         static_cast<double>(s.p_WC[2]));
    if (!X_align) X_align = *X_true_WC * X.inverse();
    const double off_m2 = ((*X_align * X).translation() - X_true_WC->translation()).squaredNorm();
    sum_m2 += off_m2;
    worst_m2 = std::max(worst_m2, off_m2);
    ++n;
  }
  if (n > 0) {
    out.ate_first_pose_mm = 1e3 * std::sqrt(sum_m2 / static_cast<double>(n));
    out.off_mm = 1e3 * std::sqrt(worst_m2);
  }
  return out;
}

RecordingFigures recording_figures(const std::string& dir,
                                   const std::vector<tasks::FusionSample>& samples) {
  const auto truth = truth_of(dir);
  const auto sequence = open_sequence(dir);
  std::optional<rt::Time> first_exposure;
  const auto stamp_s = [&](rt::Time exposure) {
    return sequence.stamp_s(0) + rt::seconds(exposure - *first_exposure);
  };
  std::vector<tasks::FusionSample> shown;
  for (const auto& s : samples) {
    if (!s.consumed) continue;
    if (!first_exposure) first_exposure = s.exposure;
    // The held last frame counts once.
    if (stamp_s(s.exposure) > sequence.stamp_s(sequence.size() - 1) + 0.5 / 30) break;
    shown.push_back(s);
  }
  return tracking_figures(shown,
                          [&](rt::Time exposure) { return pose_at(truth, stamp_s(exposure)); });
}

}  // namespace teletact
