#include "tools/teletact/recording_truth.hpp"

#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"

namespace teletact {

namespace {

drivers::TumSequence open_sequence(const std::string& dir) {
  auto sequence = drivers::TumSequence::open(dir);
  if (!sequence) throw std::runtime_error(sequence.error());
  return std::move(sequence).value();
}

struct TruePose {
  double t_s = 0;
  perception::Pose X_WC;
};

std::vector<TruePose> read_truth(const std::string& path) {
  std::vector<TruePose> out;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    double t = 0, x = 0, y = 0, z = 0, qx = 0, qy = 0, qz = 0, qw = 1;
    if (!(fields >> t >> x >> y >> z >> qx >> qy >> qz >> qw)) continue;
    TruePose p;
    p.t_s = t;
    p.X_WC = perception::Pose::Identity();
    p.X_WC.linear() = Eigen::Quaterniond(qw, qx, qy, qz).normalized().toRotationMatrix();
    p.X_WC.translation() = perception::Vec3(x, y, z);
    out.push_back(p);
  }
  return out;
}

}  // namespace

double recording_seconds(const std::string& dir) {
  const auto sequence = open_sequence(dir);
  return sequence.size() < 2 ? 0.0 : sequence.stamp_s(sequence.size() - 1) - sequence.stamp_s(0);
}

RecordingFigures recording_figures(const std::string& dir,
                                   const std::vector<tasks::FusionSample>& samples) {
  RecordingFigures out;
  const auto truth = read_truth(dir + "/groundtruth.txt");
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
    if (!s.claimed || truth.empty()) continue;
    const TruePose* best = &truth.front();
    for (const auto& p : truth) {
      if (std::abs(p.t_s - t) < std::abs(best->t_s - t)) best = &p;
    }
    perception::Pose X = perception::Pose::Identity();
    X.linear() = Eigen::Quaternionf(s.q_WC[3], s.q_WC[0], s.q_WC[1], s.q_WC[2])
                     .cast<double>()
                     .normalized()
                     .toRotationMatrix();
    X.translation() =
        perception::Vec3(static_cast<double>(s.p_WC[0]), static_cast<double>(s.p_WC[1]),
                         static_cast<double>(s.p_WC[2]));
    if (!have_first) {
      X_align = best->X_WC * X.inverse();
      have_first = true;
    }
    sum += ((X_align * X).translation() - best->X_WC.translation()).squaredNorm();
    ++n;
  }
  if (n > 0) out.ate_first_pose_mm = 1e3 * std::sqrt(sum / static_cast<double>(n));
  return out;
}

}  // namespace teletact
