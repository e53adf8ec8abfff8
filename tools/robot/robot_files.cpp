#include "tools/robot/robot_files.hpp"

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tools/files/csv.hpp"

namespace teletact {

namespace {

const std::vector<std::string>& wheel_columns() {
  static const std::vector<std::string> columns{"t_s", "front_left", "front_right", "back_left",
                                                "back_right"};
  return columns;
}

}  // namespace

rt::Result<std::vector<WheelAngles>> read_wheels(const std::string& path,
                                                 double ticks_per_motor_turn, double gear_ratio) {
  constexpr double kLeap_rad = 30;
  const auto table = read_csv(path);
  if (!table) return rt::Error{table.error()};
  const auto rows = numeric_rows(table.value(), wheel_columns());
  if (!rows) return rt::Error{rows.error()};
  const double unit =
      ticks_per_motor_turn > 0 ? 2 * std::numbers::pi / (ticks_per_motor_turn * gear_ratio) : 1.0;
  std::vector<WheelAngles> out;
  for (std::size_t r = 0; r < rows.value().size(); ++r) {
    WheelAngles w;
    w.t_s = rows.value()[r][0];
    for (std::size_t i = 0; i < w.rad.size(); ++i) {
      w.rad[i] = unit * rows.value()[r][i + 1];
      if (out.empty() || std::abs(w.rad[i] - out.back().rad[i]) <= kLeap_rad) continue;
      char text[160];
      std::snprintf(text, sizeof text,
                    ": %s leaps by %.0f rad from the row before; at most %.0f are believed (a "
                    "counter that wrapped, or another unit)",
                    wheel_columns()[i + 1].c_str(), w.rad[i] - out.back().rad[i], kLeap_rad);
      return rt::Error{path + ":" + std::to_string(table.value().lines[r]) + text};
    }
    out.push_back(w);
  }
  return out;
}

std::string wheels_csv(const std::vector<WheelAngles>& wheels) {
  std::string out = "t_s,front_left,front_right,back_left,back_right\n";
  char line[200];
  for (const WheelAngles& w : wheels) {
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.9f,%.9f,%.9f\n", w.t_s, w.rad[0], w.rad[1],
                  w.rad[2], w.rad[3]);
    out += line;
  }
  return out;
}

std::string poses_text(const std::vector<CameraSeen>& cameras) {
  std::string out = "# camera to world, claimed ones\n# timestamp tx ty tz qx qy qz qw\n";
  char line[300];
  for (const CameraSeen& c : cameras) {
    const perception::Vec3 p = c.X_WC.translation();
    const Eigen::Quaterniond q(c.X_WC.linear());
    const double sign = q.w() < 0 ? -1 : 1;
    std::snprintf(line, sizeof line, "%.6f %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", c.t_s, p.x(),
                  p.y(), p.z(), sign * q.x(), sign * q.y(), sign * q.z(), sign * q.w());
    out += line;
  }
  return out;
}

std::string calibration_toml(const RobotFit& fit, const RobotModel& stated,
                             const std::string& day) {
  const auto kept = [&](RobotParameter p) {
    return fit.of(p).constrained ? "" : "  # not constrained by the drive: as stated";
  };
  const auto angles = mount_angles_deg(fit.found.X_BC.linear());
  const perception::Vec3 p = fit.found.X_BC.translation();
  const auto& b = fit.found.base;
  char text[1400];
  const std::string place = unconstrained(fit, true);
  std::snprintf(
      text, sizeof text,
      "# Measured by teletact identify robot on %s: %.0f s, %.1f m, %.0f degrees of turns.\n"
      "# Not constrained by the drive, as stated: %s.\n"
      "[camera]\nmount_position_m = [%.5f, %.5f, %.5f]%s\nmount_yaw_deg = %.4f%s\n"
      "mount_pitch_deg = %.4f%s\nmount_roll_deg = %.4f%s\n\n"
      "[robot_io.base]\nwheel_radius_m = %.6g\n"
      "wheel_scale = [%.6f, %.6f, %.6f, %.6f]\nlever_scale = %.6f%s\nslide_scale = %.6f%s\n",
      day.c_str(), fit.seconds, fit.way_m, fit.turn_rad * 180 / std::numbers::pi,
      place.empty() ? "nothing" : place.c_str(), p.x(), p.y(), p.z(), kept(RobotParameter::kZ),
      angles[0], kept(RobotParameter::kYaw), angles[1], kept(RobotParameter::kPitch), angles[2],
      kept(RobotParameter::kRoll), stated.base.wheel_radius_m, b.wheel_scale[0], b.wheel_scale[1],
      b.wheel_scale[2], b.wheel_scale[3], b.lever_scale, kept(RobotParameter::kLever),
      b.slide_scale, kept(RobotParameter::kSlide));
  return text;
}

}  // namespace teletact
