#include "tasks/fusion/pose_prior.hpp"

#include <algorithm>
#include <numbers>

namespace tasks {

namespace {

using perception::MotionPrior;
using Twist = Eigen::Matrix<double, 6, 1>;

constexpr double kRadPerDegree = std::numbers::pi / 180;

// (v, w) with exp_se3(v, w) = X.
Twist twist_of(const Pose& X) noexcept {
  const Eigen::AngleAxisd r(X.linear());
  Twist xi;
  xi << X.translation(), r.angle() * r.axis();
  return xi;
}

Pose between(const Pose& a, const Pose& b, double f) noexcept {
  const Pose step = a.inverse() * b;
  return perception::orthonormalised(a * perception::exp_se3(f * twist_of(step)));
}

double seconds_between(rt::Time a, rt::Time b) noexcept { return rt::seconds(b - a); }

}  // namespace

MotionPrior PosePredictor::predict(const CameraState& last, rt::Time exposure) noexcept {
  MotionPrior prior;
  const std::optional<Pose> X_OB = log_.X_OB_at(exposure);
  if (X_OB && X_OB_last_) {
    const Pose step_B = X_OB_last_->inverse() * *X_OB;
    const double way = step_B.translation().norm();
    const double turn_deg = perception::rotation_angle(step_B.linear()) / kRadPerDegree;
    sigma_translation_m_ += config_.odometry_translation_share * way;
    sigma_rotation_deg_ +=
        config_.odometry_rotation_share * turn_deg + config_.odometry_deg_per_m * way;
    const Pose step_C = X_BC_.inverse() * step_B * X_BC_;
    prior.X_WC = last.X_WC * step_C;
    chain_.carry(step_C, config_.odometry_translation_share * way,
                 config_.odometry_rotation_share * turn_deg + config_.odometry_deg_per_m * way);
    prior.X_WC_odometry = chain_.X_WC();
    prior.source = MotionPrior::Source::kOdometry;
    prior.sigma_translation_m = sigma_translation_m_;
    prior.sigma_rotation_deg = sigma_rotation_deg_;
  } else {
    // Without odometry over the whole interval, a later odometry step starts from nothing known.
    sigma_translation_m_ = sigma_rotation_deg_ = 1e3;
    chain_.restart(last.X_WC);
    const double dt = seconds_between(last.exposure, exposure);
    prior.X_WC = last.X_WC * perception::exp_se3(dt * velocity_);
  }
  X_OB_last_ = X_OB;
  prior.X_WC = perception::orthonormalised(prior.X_WC);
  return prior;
}

void PosePredictor::settle(const CameraState& last, const perception::TrackingResult& r,
                           rt::Time exposure, Settled how) noexcept {
  if (how.first) {
    X_OB_last_ = log_.X_OB_at(exposure);
  } else {
    const double dt = seconds_between(last.exposure, exposure);
    // A pose among rivals says nothing of the camera's motion.
    if (how.certain || how.lost)
      velocity_ = twist_of(last.X_WC.inverse() * r.X_WC) / std::max(dt, 1e-3);
    if (!r.claimed) velocity_ *= config_.velocity_decay;
    // Between two frames of which one was only found, a way is a leap and no motion.
    if (how.lost) velocity_.setZero();
  }
  if (r.fully_constrained) sigma_translation_m_ = sigma_rotation_deg_ = 0;
  if (how.first || how.lost) chain_.restart(r.X_WC);
  if (r.claimed) chain_.follow(r.X_WC);
}

// ---------------------------------------------------------------- odometry

void OdometryLog::remember(const std::optional<OdometryPrior>& odometry) noexcept {
  if (!odometry || !odometry->X_OB.matrix().allFinite()) return;
  if (count_ > 0) {
    const OdometryPrior& newest = samples_[(count_ - 1) % kSamples];
    if (odometry->taken <= newest.taken) return;
  }
  samples_[count_++ % kSamples] = *odometry;
}

std::optional<Pose> OdometryLog::X_OB_at(rt::Time t) const noexcept {
  if (count_ == 0) return std::nullopt;
  const OdometryPrior& newest = samples_[(count_ - 1) % kSamples];
  if (t >= newest.taken) {
    const double dt = seconds_between(newest.taken, t);
    if (dt > 0.1) return std::nullopt;
    Twist xi;
    xi << newest.v_OB_B * dt, newest.w_OB_B * dt;
    return perception::orthonormalised(newest.X_OB * perception::exp_se3(xi));
  }
  const std::uint64_t held = std::min<std::uint64_t>(count_, kSamples);
  for (std::uint64_t i = 1; i < held; ++i) {
    const OdometryPrior& after = samples_[(count_ - i) % kSamples];
    const OdometryPrior& before = samples_[(count_ - i - 1) % kSamples];
    if (before.taken > t) continue;
    const double f = seconds_between(before.taken, t) / seconds_between(before.taken, after.taken);
    return between(before.X_OB, after.X_OB, f);
  }
  return std::nullopt;
}

}  // namespace tasks
