// Odometry beside a recording: TUM lines "t tx ty tz qx qy qz qw", camera to its own start, read strictly.
#pragma once

#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "rt/result.hpp"

namespace teletact {

struct OdometryLine {
  double t_s = 0;
  perception::Pose X = perception::Pose::Identity();
};

// At least one line; stamps rise strictly. An error names file, line and value.
[[nodiscard]] rt::Result<std::vector<OdometryLine>> read_odometry(const std::string& path);

}  // namespace teletact
