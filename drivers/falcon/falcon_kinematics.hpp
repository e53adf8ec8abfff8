// Kinematics of the Falcon's delta (R. E. Stamper, A Three Degree of Freedom Parallel Manipulator
// with Only Translational Degrees of Freedom, 1997), with the dimensions that libnifalcon measured.
//
// Frame F (Falcon): x to the right, y up, z out of the device toward the operator, origin at the
// centre of its base. theta: the angles of the three thighs, rad. With phi a leg's direction,
//   u = x cos phi + y sin phi - r,  v = -x sin phi + y cos phi - s + f,  w = z
// and the length of the shin seen in the leg's plane L = d + e + sqrt(b^2 - v^2), the leg closes
// when
//   (u + c - a cos theta)^2 + (w - a sin theta)^2 = L^2.
// inverse() solves that in closed form (knee outward); its derivative gives the Jacobian; forward()
// is Newton on the three angles. SI. No allocation, bounded.
#pragma once

#include "perception/geometry/pose.hpp"

namespace drivers {

struct FalconForward {
  perception::Vec3 p_F = perception::Vec3::Zero();
  double residual_rad = 0;  // largest |theta(p_F) - theta|
  int iterations = 0;
  bool good = false;  // residual within kResidual_rad
};

class FalconKinematics {
 public:
  static constexpr double kResidual_rad = 1e-6;  // promised
  static constexpr double kGoal_rad = 1e-10;     // iterated to, where rounding allows
  static constexpr int kMaxIterations = 30;
  static constexpr double kCentreZ_m = 0.125;  // where all three legs leave 50 mm to every side

  // False: out of reach.
  [[nodiscard]] static bool inverse(const perception::Vec3& p_F, perception::Vec3& theta) noexcept;
  // d theta / d p at a position with these angles. False: singular.
  [[nodiscard]] static bool jacobian(const perception::Vec3& p_F, const perception::Vec3& theta,
                                     perception::Mat3& dtheta_dp) noexcept;
  [[nodiscard]] static FalconForward forward(const perception::Vec3& theta,
                                             const perception::Vec3& guess_F) noexcept;
  // Motor-side torques (at the thighs, N m) that push with f_F: virtual work, tau = J^-T f with
  // J = d theta / d p. False: singular.
  [[nodiscard]] static bool torque(const perception::Mat3& dtheta_dp, const perception::Vec3& f_F,
                                   perception::Vec3& tau) noexcept;

  // 320 slots read on four edges, a 14.25 mm shaft on a 110 mm sector; zero at about 35 degrees.
  static constexpr double kRadPerCount = 2 * 3.14159265358979323846 / 1280 * (0.01425 / 0.110);
  static constexpr double kZero_rad = 35.0 * 3.14159265358979323846 / 180.0;
  [[nodiscard]] static double angle(int count) noexcept { return kZero_rad + kRadPerCount * count; }
};

}  // namespace drivers
