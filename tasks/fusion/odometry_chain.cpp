#include "tasks/fusion/odometry_chain.hpp"

#include <algorithm>
#include <numbers>

namespace tasks {

void OdometryChain::carry(const Pose& step_C, double error_m, double error_deg) noexcept {
  X_WC_ = perception::orthonormalised(X_WC_ * step_C);
  slack_m_ += error_m + kFreeWay_m;
  slack_deg_ += error_deg + kFreeTurn_deg;
}

void OdometryChain::follow(const Pose& X_WC) noexcept {
  constexpr double kDegree = std::numbers::pi / 180;
  const perception::Vec3 way = X_WC.translation() - X_WC_.translation();
  const Eigen::AngleAxisd turn(X_WC_.linear().transpose() * X_WC.linear());
  if (!(way.norm() < kGivenUp_m) || !(turn.angle() < kGivenUp_deg * kDegree)) {
    restart(X_WC);
    return;
  }
  const double f = std::min(1.0, slack_m_ / std::max(way.norm(), 1e-9)),
               g = std::min(1.0, slack_deg_ * kDegree / std::max(turn.angle(), 1e-9));
  X_WC_.translation() += f * way;
  X_WC_.linear() =
      X_WC_.linear() * Eigen::AngleAxisd(g * turn.angle(), turn.axis()).toRotationMatrix();
  X_WC_ = perception::orthonormalised(X_WC_);
  slack_m_ = slack_deg_ = 0;
}

}  // namespace tasks
