// The recorded kitchen, where it is present, and error measures against its poses.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "tests/support/paths.hpp"

namespace tests {

inline std::string recording_folder() {
  return tests::in_tree("../shared/data/rgbd/7scenes_redkitchen");
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

// Translation error, first poses aligned, mm.
struct PoseError {
  double rms_mm = 0, worst_mm = 0;
};
inline PoseError first_pose_error(const std::vector<perception::Pose>& estimate,
                                  const std::vector<perception::Pose>& truth) {
  const perception::Pose align = truth.front() * estimate.front().inverse();
  PoseError e;
  double sum = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const double off = ((align * estimate[i]).translation() - truth[i].translation()).norm();
    sum += off * off;
    e.worst_mm = std::max(e.worst_mm, 1000 * off);
  }
  e.rms_mm = 1000 * std::sqrt(sum / static_cast<double>(estimate.size()));
  return e;
}

}  // namespace tests
