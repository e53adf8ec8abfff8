// Where a base with mecanum wheels is, from the angles of its wheels: a second opinion, which
// shares no code with kinematics, odometry or the virtual robot.
//
// It knows each wheel's contact point p and the direction a of the roller that touches the floor
// there. Without slip the floor stops the contact point along a: the rim's speed along a is that of
// the body, (v + w x p) . a = r q (x . a), with q positive for forward. Four such lines for three
// unknowns: least squares by Gram and Cramer. Integrated by short straight pieces.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace tests {

class RollerTruth {
 public:
  explicit RollerTruth(const std::array<double, 4>& wheel_rad) noexcept : before_(wheel_rad) {}

  // Wheel order of the youBot: front left, front right, back left, back right; the left ones are
  // mounted the other way round.
  void see(const std::array<double, 4>& wheel_rad) noexcept {
    constexpr double r_m = 0.0475, front_m = 0.47 / 2, side_m = 0.30 / 2;
    constexpr double px[4] = {front_m, front_m, -front_m, -front_m};
    constexpr double py[4] = {side_m, -side_m, side_m, -side_m};
    constexpr double ay[4] = {-1, 1, 1, -1};  // a = (1, ay)
    double g[3][3] = {}, b[3] = {};
    for (std::size_t i = 0; i < 4; ++i) {
      const double row[3] = {1, ay[i], -py[i] + ay[i] * px[i]};
      const double turned = wheel_rad[i] - before_[i];
      const double rim_m = r_m * (i % 2 == 0 ? -turned : turned);
      for (int j = 0; j < 3; ++j) {
        b[j] += row[j] * rim_m;
        for (int k = 0; k < 3; ++k) g[j][k] += row[j] * row[k];
      }
    }
    before_ = wheel_rad;
    double way[3];
    for (int c = 0; c < 3; ++c) {
      double m[3][3];
      for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) m[j][k] = k == c ? b[j] : g[j][k];
      way[c] = determinant(m) / determinant(g);
    }
    constexpr int kPieces = 50;
    for (int i = 0; i < kPieces; ++i) {
      const double middle = yaw_rad + way[2] * (i + 0.5) / kPieces;
      x_m += (way[0] * std::cos(middle) - way[1] * std::sin(middle)) / kPieces;
      y_m += (way[0] * std::sin(middle) + way[1] * std::cos(middle)) / kPieces;
    }
    yaw_rad += way[2];
  }

  double x_m = 0, y_m = 0, yaw_rad = 0;

 private:
  static double determinant(const double (&m)[3][3]) noexcept {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
  }
  std::array<double, 4> before_;
};

}  // namespace tests
