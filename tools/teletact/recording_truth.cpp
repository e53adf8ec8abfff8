#include "tools/teletact/recording_truth.hpp"

#include <cmath>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"
#include "tools/bench/pose_file.hpp"

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

RecordingFigures recording_figures(const std::string& dir,
                                   const std::vector<tasks::FusionSample>& samples) {
  RecordingFigures out;
  const auto truth = truth_of(dir);
  const auto sequence = open_sequence(dir);
  perception::Pose X_align = perception::Pose::Identity();
  bool have_first = false;
  rt::Time first_exposure{};
  double sum = 0;
  std::size_t n = 0;
  for (const auto& s : samples) {
    if (!s.consumed) continue;
    if (first_exposure == rt::Time{}) first_exposure = s.exposure;
    const double t = sequence.stamp_s(0) + rt::seconds(s.exposure - first_exposure);
    if (t > sequence.stamp_s(sequence.size() - 1) + 0.5 / 30)
      break;  // the held last frame counts once
    ++out.frames;
    out.tracked += s.tracked ? 1 : 0;
    out.claimed += s.claimed ? 1 : 0;
    if (!s.claimed) continue;
    const auto true_WC = pose_at(truth, t);
    if (!true_WC) continue;
    perception::Pose X = perception::Pose::Identity();
    X.linear() = Eigen::Quaternionf(s.q_WC[3], s.q_WC[0], s.q_WC[1], s.q_WC[2])
                     .cast<double>()
                     .normalized()
                     .toRotationMatrix();
    X.translation() =
        perception::Vec3(static_cast<double>(s.p_WC[0]), static_cast<double>(s.p_WC[1]),
                         static_cast<double>(s.p_WC[2]));
    if (!have_first) {
      X_align = *true_WC * X.inverse();
      have_first = true;
    }
    sum += ((X_align * X).translation() - true_WC->translation()).squaredNorm();
    ++n;
  }
  if (n > 0) out.ate_first_pose_mm = 1e3 * std::sqrt(sum / static_cast<double>(n));
  return out;
}

}  // namespace teletact
