#include "tools/files/pose_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "drivers/camera/recording/tum_files.hpp"
#include "drivers/camera/sequence_layout.hpp"

namespace teletact {

namespace {

constexpr double kFarthestPose_m = 1e6;  // as a stored map

}  // namespace

rt::Result<std::vector<StampedPose>> read_poses(const std::string& path) {
  std::vector<StampedPose> lines;
  const auto ok = drivers::for_each_line(
      path, [&](int number, const std::vector<std::string>& tokens) -> rt::Result<bool> {
        static constexpr const char* kNames[] = {"t", "tx", "ty", "tz", "qx", "qy", "qz", "qw"};
        if (tokens.size() != 8) {
          return drivers::file_error(
              path, number,
              std::to_string(tokens.size()) + " values; a TUM pose has 8: t tx ty tz qx qy qz qw");
        }
        double v[8];
        for (std::size_t i = 0; i < 8; ++i) {
          auto value = drivers::parse_number(path, number, kNames[i], tokens[i]);
          if (!value) return rt::Error{value.error()};
          v[i] = value.value();
        }
        if (!lines.empty() && v[0] <= lines.back().t_s) {
          return drivers::file_error(path, number, "t = " + tokens[0] + " does not rise");
        }
        const Eigen::Quaterniond q(v[7], v[4], v[5], v[6]);
        if (!(std::abs(q.norm() - 1) <= 0.02)) {
          return drivers::file_error(
              path, number, "quaternion of length " + std::to_string(q.norm()) + "; must be 1");
        }
        const perception::Vec3 p(v[1], v[2], v[3]);
        if (!(p.norm() <= kFarthestPose_m)) {
          return drivers::file_error(path, number,
                                     "a position of " + tokens[1] + " " + tokens[2] + " " +
                                         tokens[3] + " m; allowed are 1e6 m from the origin");
        }
        StampedPose line;
        line.t_s = v[0];
        line.X.linear() = q.normalized().toRotationMatrix();
        line.X.translation() = p;
        lines.push_back(line);
        return true;
      });
  if (!ok) return rt::Error{ok.error()};
  if (lines.empty()) return rt::Error{path + ": holds no pose"};
  return lines;
}

namespace {

// Four lines of four numbers, the rotation as good as such files have it.
rt::Result<perception::Pose> read_matrix(const std::string& path) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
  int row = 0;
  const auto ok = drivers::for_each_line(
      path, [&](int number, const std::vector<std::string>& tokens) -> rt::Result<bool> {
        if (row == 4 || tokens.size() != 4) {
          return drivers::file_error(path, number, "wanted 4 lines of 4 numbers");
        }
        for (int i = 0; i < 4; ++i) {
          const auto v = drivers::parse_number(path, number, "value " + std::to_string(i + 1),
                                               tokens[static_cast<std::size_t>(i)]);
          if (!v) return rt::Error{v.error()};
          m(row, i) = v.value();
        }
        ++row;
        return true;
      });
  if (!ok) return rt::Error{ok.error()};
  if (row != 4) return drivers::file_error(path, 0, "wanted 4 lines of 4 numbers");
  const Eigen::Matrix3d R = m.topLeftCorner<3, 3>();
  if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= 1e-2 && R.determinant() > 0 &&
        (m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() <= 1e-6)) {
    return drivers::file_error(path, 0, "is not a rotation and a translation");
  }
  perception::Pose X = perception::Pose::Identity();
  X.linear() = Eigen::Quaterniond(R).normalized().toRotationMatrix();
  X.translation() = m.topRightCorner<3, 1>();
  return X;
}

}  // namespace

rt::Result<std::vector<StampedPose>> read_truth(const std::string& folder) {
  const std::string file = folder + "/groundtruth.txt";
  if (drivers::regular_file(file)) return read_poses(file);
  std::vector<int> numbers;
  std::error_code ec;
  for (auto it = std::filesystem::directory_iterator(folder, ec);
       !ec && it != std::filesystem::directory_iterator(); it.increment(ec)) {
    const auto n = drivers::seven_scenes_number(it->path().filename().string(), ".pose.txt");
    if (n) numbers.push_back(*n);
  }
  std::sort(numbers.begin(), numbers.end());
  std::vector<StampedPose> poses;
  for (const int n : numbers) {
    char name[32];
    std::snprintf(name, sizeof name, "/frame-%06d.pose.txt", n);
    const auto X = read_matrix(folder + name);
    if (!X) return rt::Error{X.error()};
    poses.push_back({n / drivers::kSevenScenesRate_hz, X.value()});
  }
  return poses;
}

std::optional<perception::Pose> pose_at(std::span<const StampedPose> poses, double t_s,
                                        double gap_s) {
  constexpr double kSame_s = 1e-5;  // stamps are written with a few decimals
  const auto after = std::lower_bound(poses.begin(), poses.end(), t_s,
                                      [](const StampedPose& p, double t) { return p.t_s < t; });
  if (after != poses.end() && after->t_s - t_s <= kSame_s) return after->X;
  if (after == poses.begin()) return std::nullopt;
  const auto before = after - 1;
  if (t_s - before->t_s <= kSame_s) return before->X;
  if (after == poses.end()) return std::nullopt;
  const double span = after->t_s - before->t_s, f = (t_s - before->t_s) / span;
  if (span > 2 * gap_s) return std::nullopt;
  perception::Pose X = perception::Pose::Identity();
  X.translation() = (1 - f) * before->X.translation() + f * after->X.translation();
  X.linear() = Eigen::Quaterniond(before->X.linear())
                   .slerp(f, Eigen::Quaterniond(after->X.linear()))
                   .toRotationMatrix();
  return X;
}

}  // namespace teletact
