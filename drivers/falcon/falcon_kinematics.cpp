#include "drivers/falcon/falcon_kinematics.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace drivers {
namespace {

using perception::Mat3;
using perception::Vec3;

constexpr double kThigh = 0.060, kShin = 0.1025, kPlate = 0.014;  // a, b, c
constexpr double kJoints = 2 * 0.01125;                           // d + e
constexpr double kPlateSide = -0.025;                             // f
constexpr double kBase = 0.037233758, kBaseSide = -0.027330909;   // r, s

struct Leg {
  double cos_phi = 1, sin_phi = 0;
};

const std::array<Leg, 3>& legs() noexcept {
  static const std::array<Leg, 3> all = [] {
    constexpr double pi = std::numbers::pi;
    std::array<Leg, 3> out;
    const std::array<double, 3> phi{pi / 2 + pi / 12, -pi / 6 + pi / 12, -5 * pi / 6 + pi / 12};
    for (std::size_t i = 0; i < 3; ++i) out[i] = {std::cos(phi[i]), std::sin(phi[i])};
    return out;
  }();
  return all;
}

// Of one leg at p: u + c, v, w and L; false when the shin does not reach.
struct LegPlane {
  double u = 0, v = 0, w = 0, side = 0, reach = 0;  // side = sqrt(b^2 - v^2)
};
bool leg_plane(const Leg& leg, const Vec3& p, LegPlane& out) noexcept {
  out.u = leg.cos_phi * p.x() + leg.sin_phi * p.y() - kBase + kPlate;
  out.v = -leg.sin_phi * p.x() + leg.cos_phi * p.y() - kBaseSide + kPlateSide;
  out.w = p.z();
  const double left = kShin * kShin - out.v * out.v;
  if (!(left > 0)) return false;
  out.side = std::sqrt(left);
  out.reach = kJoints + out.side;
  return true;
}

double largest(const Vec3& v) noexcept { return v.cwiseAbs().maxCoeff(); }

}  // namespace

bool FalconKinematics::inverse(const Vec3& p_F, Vec3& theta) noexcept {
  Vec3 out;
  for (int i = 0; i < 3; ++i) {
    LegPlane q;
    if (!leg_plane(legs()[static_cast<std::size_t>(i)], p_F, q)) return false;
    // u cos theta + w sin theta = k: the thigh's tip on a circle of radius L round (u, w).
    const double distance = std::hypot(q.u, q.w);
    const double k = (q.u * q.u + q.w * q.w + kThigh * kThigh - q.reach * q.reach) / (2 * kThigh);
    if (!(std::abs(k) <= distance)) return false;
    out[i] = std::atan2(q.w, q.u) - std::acos(k / distance);
  }
  theta = out;
  return true;
}

bool FalconKinematics::jacobian(const Vec3& p_F, const Vec3& theta, Mat3& dtheta_dp) noexcept {
  for (int i = 0; i < 3; ++i) {
    const Leg& leg = legs()[static_cast<std::size_t>(i)];
    LegPlane q;
    if (!leg_plane(leg, p_F, q)) return false;
    const double c = std::cos(theta[i]), s = std::sin(theta[i]);
    const double du = q.u - kThigh * c, dw = q.w - kThigh * s;
    // Half the derivatives of the closure F(u, v, w, theta); dL/dv = -v / sqrt(b^2 - v^2).
    const double F_u = du, F_w = dw, F_v = q.reach * q.v / q.side;
    const double F_theta = kThigh * (du * s - dw * c);
    if (!(std::abs(F_theta) > 1e-9)) return false;  // thigh and shin in line
    dtheta_dp(i, 0) = -(F_u * leg.cos_phi - F_v * leg.sin_phi) / F_theta;
    dtheta_dp(i, 1) = -(F_u * leg.sin_phi + F_v * leg.cos_phi) / F_theta;
    dtheta_dp(i, 2) = -F_w / F_theta;
  }
  return true;
}

FalconForward FalconKinematics::forward(const Vec3& theta, const Vec3& guess_F) noexcept {
  constexpr double kLongestStep_m = 0.03;
  FalconForward out;
  out.p_F = guess_F;
  Vec3 now;
  if (!theta.allFinite() || !inverse(out.p_F, now)) {
    out.p_F = Vec3(0, 0, kCentreZ_m);
    if (!theta.allFinite() || !inverse(out.p_F, now)) return out;
  }
  out.residual_rad = largest(theta - now);
  while (out.iterations < kMaxIterations && out.residual_rad > kGoal_rad) {
    ++out.iterations;
    Mat3 J;
    if (!jacobian(out.p_F, now, J)) break;
    const double det = J.determinant();
    if (!(std::abs(det) > 1e-6)) break;
    Vec3 step = J.inverse() * (theta - now);
    const double size = step.norm();
    if (size > kLongestStep_m) step *= kLongestStep_m / size;
    // Halved until it is in reach and nearer; rounding ends the search.
    bool nearer = false;
    for (int halving = 0; halving < 12 && !nearer; ++halving, step *= 0.5) {
      Vec3 there;
      if (!inverse(out.p_F + step, there)) continue;
      const double residual = largest(theta - there);
      if (residual < out.residual_rad) {
        out.p_F += step;
        now = there;
        out.residual_rad = residual;
        nearer = true;
      }
    }
    if (!nearer) break;
  }
  out.good = out.residual_rad <= kResidual_rad;
  return out;
}

bool FalconKinematics::torque(const Mat3& dtheta_dp, const Vec3& f_F, Vec3& tau) noexcept {
  const double det = dtheta_dp.determinant();
  if (!(std::abs(det) > 1e-6)) return false;
  tau = dtheta_dp.transpose().inverse() * f_F;
  return tau.allFinite();
}

}  // namespace drivers
