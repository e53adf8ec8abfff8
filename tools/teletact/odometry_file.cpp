#include "tools/teletact/odometry_file.hpp"

#include <cmath>

#include "drivers/camera/tum_files.hpp"

namespace teletact {

rt::Result<std::vector<OdometryLine>> read_odometry(const std::string& path) {
  std::vector<OdometryLine> lines;
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
        OdometryLine line;
        line.t_s = v[0];
        line.X.linear() = q.normalized().toRotationMatrix();
        line.X.translation() = perception::Vec3(v[1], v[2], v[3]);
        lines.push_back(line);
        return true;
      });
  if (!ok) return rt::Error{ok.error()};
  if (lines.empty()) return rt::Error{path + ": no pose in it"};
  return lines;
}

}  // namespace teletact
