// The recorded kitchen, where it is present, and error measures against its poses.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"

namespace tests {

inline std::string recording_folder() {
  return std::string(TELETACT_SOURCE_DIR) + "/../shared/data/rgbd/7scenes_redkitchen";
}
inline bool have_recording() { return std::filesystem::exists(recording_folder() + "/depth.txt"); }

inline std::vector<perception::Pose> recorded_poses() {
  std::ifstream in(recording_folder() + "/groundtruth.txt");
  std::vector<perception::Pose> poses;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream s(line);
    double t, x, y, z, qx, qy, qz, qw;
    s >> t >> x >> y >> z >> qx >> qy >> qz >> qw;
    perception::Pose X = perception::Pose::Identity();
    X.linear() = Eigen::Quaterniond(qw, qx, qy, qz).normalized().toRotationMatrix();
    X.translation() = perception::Vec3(x, y, z);
    poses.push_back(X);
  }
  return poses;
}

// RMS translation error, first poses aligned, mm.
inline double ate_first_pose_mm(const std::vector<perception::Pose>& estimate,
                                const std::vector<perception::Pose>& truth) {
  const perception::Pose align = truth.front() * estimate.front().inverse();
  double sum = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    sum += ((align * estimate[i]).translation() - truth[i].translation()).squaredNorm();
  }
  return 1000 * std::sqrt(sum / static_cast<double>(estimate.size()));
}

}  // namespace tests
