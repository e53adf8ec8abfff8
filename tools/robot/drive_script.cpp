#include "tools/robot/drive_script.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace teletact {

using perception::Pose2;
using perception::Twist2;

DriveScript::DriveScript() {
  constexpr double kQuarter = std::numbers::pi / 2;
  constexpr double kCircle_m = 0.4;  // radius
  const auto leg = [this](const char* what, double x, double y, double turn) {
    // As long as the slower of both takes.
    const double s = std::max(std::hypot(x, y) / kSpeed_m_per_s, std::abs(turn) / kTurn_rad_per_s);
    legs_.push_back({what, {x / s, y / s, turn / s}, s + kRamp_s});
  };
  leg("forwards", 0.8, 0, 0);
  leg("back", -0.4, 0, 0);
  leg("to the left", 0, 0.6, 0);
  leg("to the right", 0, -1.2, 0);
  leg("to the left", 0, 0.6, 0);
  leg("turn left", 0, 0, kQuarter);
  leg("turn right", 0, 0, -2 * kQuarter);
  leg("turn left", 0, 0, kQuarter);
  leg("circle to the left", 4 * kQuarter * kCircle_m, 0, 4 * kQuarter);
  leg("circle to the right", 4 * kQuarter * kCircle_m, 0, -4 * kQuarter);
  leg("back", -0.4, 0, 0);
}

double DriveScript::seconds() const {
  double s = 0;
  for (const DriveLeg& l : legs_) s += l.seconds + kRest_s;
  return s;
}

Twist2 DriveScript::at(double t) const {
  if (t < 0) return {};
  for (const DriveLeg& l : legs_) {
    if (t < l.seconds) {
      const double share = std::clamp(std::min(t, l.seconds - t) / kRamp_s, 0.0, 1.0);
      return {share * l.v.vx, share * l.v.vy, share * l.v.wz};
    }
    t -= l.seconds + kRest_s;
    if (t < 0) return {};
  }
  return {};
}

DriveScript::Room DriveScript::room() const {
  constexpr double kStep_s = 0.01;
  Room r;
  Pose2 X;
  for (double t = 0; t < seconds(); t += kStep_s) {
    X = perception::integrate(X, at(t + kStep_s / 2), kStep_s);
    r.x_least_m = std::min(r.x_least_m, X.x), r.x_most_m = std::max(r.x_most_m, X.x);
    r.y_least_m = std::min(r.y_least_m, X.y), r.y_most_m = std::max(r.y_most_m, X.y);
  }
  return r;
}

std::string DriveScript::csv() const {
  std::string out = "t_s,vx,vy,wz\n";
  const int rows = static_cast<int>(seconds() * 50) + 1;
  for (int i = 0; i <= rows; ++i) {
    char line[120];
    const double t = i / 50.0;
    const Twist2 v = at(t);
    std::snprintf(line, sizeof line, "%.2f,%.4f,%.4f,%.4f\n", t, v.vx, v.vy, v.wz);
    out += line;
  }
  return out;
}

}  // namespace teletact
