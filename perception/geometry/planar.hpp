// Rigid motions of the ground plane, SE(2): what wheels, odometry and path following speak.
//
//   Pose2   X_AB as (x, y, yaw): p_A = R(yaw) p_B + (x, y). Radians, anticlockwise, SI.
//   Twist2  velocity of a body, expressed in the body frame: vx forward, vy left, wz anticlockwise.
//
// Inner letters cancel as in pose.hpp: X_AC = compose(X_AB, X_BC).
#pragma once

#include <cmath>
#include <numbers>

namespace perception {

struct Pose2 {
  double x = 0, y = 0, yaw = 0;
  friend bool operator==(const Pose2&, const Pose2&) = default;
};

struct Twist2 {
  double vx = 0, vy = 0, wz = 0;
  friend bool operator==(const Twist2&, const Twist2&) = default;
};

// The angle in (-pi, pi]. Finite input of any size; NaN stays NaN.
[[nodiscard]] inline double wrap_angle(double a) noexcept {
  const double r = std::remainder(a, 2.0 * std::numbers::pi);
  return r <= -std::numbers::pi ? std::numbers::pi : r;
}

[[nodiscard]] inline bool is_finite(const Pose2& p) noexcept {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.yaw);
}
[[nodiscard]] inline bool is_finite(const Twist2& v) noexcept {
  return std::isfinite(v.vx) && std::isfinite(v.vy) && std::isfinite(v.wz);
}

[[nodiscard]] inline Pose2 compose(const Pose2& X_AB, const Pose2& X_BC) noexcept {
  const double c = std::cos(X_AB.yaw), s = std::sin(X_AB.yaw);
  return {X_AB.x + c * X_BC.x - s * X_BC.y, X_AB.y + s * X_BC.x + c * X_BC.y,
          wrap_angle(X_AB.yaw + X_BC.yaw)};
}

[[nodiscard]] inline Pose2 inverse(const Pose2& X_AB) noexcept {
  const double c = std::cos(X_AB.yaw), s = std::sin(X_AB.yaw);
  return {-c * X_AB.x - s * X_AB.y, s * X_AB.x - c * X_AB.y, wrap_angle(-X_AB.yaw)};
}

// exp: where a body that starts at the origin is after moving by `d` = twist times time, with the
// twist constant in the body frame (an arc). The series keeps full precision for tiny angles.
[[nodiscard]] inline Pose2 exp_se2(const Twist2& d) noexcept {
  const double a = d.wz;
  double sinc, cosc;  // sin(a)/a and (1 - cos(a))/a
  if (std::abs(a) < 1e-4) {
    sinc = 1.0 - a * a / 6.0;
    cosc = a / 2.0 - a * a * a / 24.0;
  } else {
    sinc = std::sin(a) / a;
    cosc = (1.0 - std::cos(a)) / a;
  }
  return {sinc * d.vx - cosc * d.vy, cosc * d.vx + sinc * d.vy, wrap_angle(a)};
}

// X_AB after its body moved with the constant body twist `v` for `dt` seconds: exact.
[[nodiscard]] inline Pose2 integrate(const Pose2& X_AB, const Twist2& v, double dt) noexcept {
  return compose(X_AB, exp_se2({v.vx * dt, v.vy * dt, v.wz * dt}));
}

}  // namespace perception
