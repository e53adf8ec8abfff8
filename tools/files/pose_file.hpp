// Poses beside a recording, as odometry or as truth: TUM lines "t tx ty tz qx qy qz qw", s and m, read strictly.
// They have stamps of their own: what a frame's pose is, is asked by the frame's stamp and never by a line's number.
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

// Where the camera of a recording truly was: its groundtruth.txt, else the frame-NNNNNN.pose.txt of 7-Scenes (4 x 4,
// camera to world) at 30 Hz. Empty: there is neither.
[[nodiscard]] rt::Result<std::vector<StampedPose>> read_truth(const std::string& folder);

// A frame may be this far from the nearest pose: a hole of the file tells nothing about what is in it.
inline constexpr double kPoseGap_s = 0.020;
// Pose at t between two lines that are at most 2 gap_s apart, straight from one to the other at
// even speed, turning about one axis; a line within 10 us of t is taken as it is. None in a wider hole and beyond the ends.
[[nodiscard]] std::optional<perception::Pose> pose_at(std::span<const StampedPose> poses,
                                                      double t_s, double gap_s = kPoseGap_s);

}  // namespace teletact
