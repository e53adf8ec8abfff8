// Poses beside a recording, as odometry or as ground truth: TUM lines "t tx ty tz qx qy qz qw", s
// and m, read strictly. They have stamps of their own, so the pose of a frame is looked up by the
// frame's stamp, never by a line's number.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "rt/result.hpp"

namespace teletact {

struct StampedPose {
  double t_s = 0;
  perception::Pose X = perception::Pose::Identity();
};

// At least one line; stamps rise strictly. An error names file, line and value.
[[nodiscard]] rt::Result<std::vector<StampedPose>> read_poses(const std::string& path);

// The ground truth of a recording's camera: its groundtruth.txt, else the frame-NNNNNN.pose.txt of
// 7-Scenes (4 x 4, camera to world) at 30 Hz. Empty: there is neither.
[[nodiscard]] rt::Result<std::vector<StampedPose>> read_truth(const std::string& folder);

// Largest distance in time of a frame from the nearest pose. Within a longer gap of the file no
// pose is known.
inline constexpr double kPoseGap_s = 0.020;
// Pose at t, interpolated between two lines that are at most 2 gap_s apart: straight motion at even
// speed, rotation about one axis. A line within 10 us of t is used as it is. None in a wider gap
// and beyond the ends.
[[nodiscard]] std::optional<perception::Pose> pose_at(std::span<const StampedPose> poses,
                                                      double t_s, double gap_s = kPoseGap_s);

}  // namespace teletact
