#include "tasks/prediction/realised_error.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

void RealisedError::clear() noexcept {
  head_ = size_ = 0;
  sum_.setZero();
  weight_ = 0;
}

void RealisedError::add(const MotionHistory& history, double h,
                        const perception::Pose2& predicted_X_OB) noexcept {
  const MotionSample& now = history.newest();
  while (size_ > 0) {
    const Pending& p = pending_[head_];
    if (p.t + p.h > now.t) break;
    head_ = (head_ + 1) % kPending;
    --size_;
    perception::Pose2 X;
    if (!history.pose_at(p.t + p.h, X)) continue;
    const perception::Pose2 to_B = perception::inverse(p.X_OB);
    const perception::Pose2 truth = perception::compose(to_B, X),
                            said = perception::compose(to_B, p.predicted_X_OB);
    const Eigen::Vector3d e = Eigen::Vector3d(said.x - truth.x, said.y - truth.y,
                                              perception::wrap_angle(said.yaw - truth.yaw)) /
                              (p.h * p.h);
    const double since = weight_ > 0 ? std::clamp(p.t - settled_t_, 0.0, 1.0) : 0.1;
    settled_t_ = p.t;
    const double fade = std::exp(-since / kMemory_s);
    sum_ = fade * sum_ + since * e * e.transpose();
    weight_ = fade * weight_ + since;
  }
  if (size_ > 0 && now.t - pending_[(head_ + size_ - 1) % kPending].t <
                       std::max(MotionHistory::kMinSpacing_s, h / 32)) {
    return;
  }
  if (size_ == kPending) {
    head_ = (head_ + 1) % kPending;
    --size_;
  }
  pending_[(head_ + size_++) % kPending] = {now.t, h, now.X_OB, predicted_X_OB};
}

RealisedError::Matrix3 RealisedError::covariance(double h) const noexcept {
  // Prior: half of an ordinary start or stop that nobody foresaw, 1 m/s^2 and 3 rad/s^2, squared.
  // It fades as old errors do. Never less than what 0.01 m/s^2 and 0.03 rad/s^2 make.
  const Eigen::Vector3d prior(0.25, 0.25, 2.25), least(1e-4, 1e-4, 1e-3);
  const double weight = kPriorTime_s * std::max(0.0, 1 - weight_ / kMemory_s);
  Matrix3 C = least.asDiagonal();
  if (weight + weight_ > 0) {
    Matrix3 sum = sum_;
    sum.diagonal() += weight * prior;
    C += sum / (weight_ + weight);
  }
  const double h2 = h * h;
  return h2 * h2 * C;
}

}  // namespace tasks
