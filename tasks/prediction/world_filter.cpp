#include "tasks/prediction/world_filter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace tasks {

using perception::compose;
using perception::inverse;
using perception::Pose2;
using perception::wrap_angle;

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kGate = 16.27;  // chi-square, 3 degrees of freedom, 0.999
// Below this a covariance is no statement about a real robot; keeps the update well conditioned.
constexpr double kLeast = 1e-12;

Eigen::Vector3d difference(const Pose2& a, const Pose2& b) noexcept {
  return {a.x - b.x, a.y - b.y, wrap_angle(a.yaw - b.yaw)};
}

}  // namespace

WorldFilter::WorldFilter(const WorldFilterConfig& c, bool start_known) noexcept : config_(c) {
  const double t = c.odometry_translation_share, d = c.odometry_deg_per_m * kDegree,
               r = c.odometry_rotation_share, turn = c.camera_deg * kDegree;
  share2_ = {t * t, t * t, d * d, r * r};
  camera_ =
      Eigen::Vector3d(c.camera_m * c.camera_m, c.camera_m * c.camera_m, turn * turn).asDiagonal();
  if (!start_known) {
    at_first_.P =
        Eigen::Vector3d(kUnknown_m * kUnknown_m, kUnknown_m * kUnknown_m, 100.0).asDiagonal();
    at_newest_ = at_first_;
  }
}

// A step of the base: what was wrong before turns the step as well, what is wrong in it acts from
// half of it on.
void WorldFilter::carry(Error& e, double dx, double dy, double turn) noexcept {
  Matrix3 F = Matrix3::Identity();
  F(0, 2) = -dy;
  F(1, 2) = dx;
  const double way = std::hypot(dx, dy);
  Sensitivity G;
  G << dx, -dy, -0.5 * dy * way, -0.5 * dy * turn,  //
      dy, dx, 0.5 * dx * way, 0.5 * dx * turn,      //
      0, 0, way, turn;
  e.P = F * e.P * F.transpose();
  e.J = F * e.J + G;
}

void WorldFilter::carry(Error& e, const Pose2& from_O, const Pose2& to_O) const noexcept {
  const double c = std::cos(X_WO_.yaw), s = std::sin(X_WO_.yaw);
  const double dx = to_O.x - from_O.x, dy = to_O.y - from_O.y;
  carry(e, c * dx - s * dy, s * dx + c * dy, wrap_angle(to_O.yaw - from_O.yaw));
}

WorldFilter::Matrix3 WorldFilter::total(const Error& e) const noexcept {
  return e.P + e.J * share2_.asDiagonal() * e.J.transpose();
}

WorldFilter::Matrix3 WorldFilter::stated(const Error& e) const noexcept {
  return total(e) + camera_;
}

double WorldFilter::error_of(const Error& e) const noexcept {
  const Matrix3 S = stated(e);
  const double mean = 0.5 * (S(0, 0) + S(1, 1)), half = 0.5 * (S(0, 0) - S(1, 1));
  return 3.0 * std::sqrt(mean + std::hypot(half, S(0, 1))) + (refused_ > 0 ? off_m_ : 0.0);
}

double WorldFilter::error_rad() const noexcept { return 3.0 * std::sqrt(stated(at_newest_)(2, 2)); }

double WorldFilter::error_after_m(double dx_W, double dy_W) const noexcept {
  Error e = at_newest_;
  carry(e, dx_W, dy_W, 0);
  return error_of(e);
}

bool WorldFilter::add_odometry(double t, const Pose2& X_OB) noexcept {
  if (!std::isfinite(t) || !perception::is_finite(X_OB)) return false;
  if (size_ > 0 && !(t > sample(size_ - 1).t)) return false;
  if (size_ > 0) carry(at_newest_, sample(size_ - 1).X_OB, X_OB);
  if (size_ == kSamples) {  // what is older than the memory is settled
    carry(at_first_, sample(0).X_OB, sample(1).X_OB);
    head_ = (head_ + 1) % kSamples;
    --size_;
  }
  samples_[static_cast<std::size_t>((head_ + size_) % kSamples)] = {t, X_OB};
  ++size_;
  return true;
}

void WorldFilter::restart_odometry() noexcept {
  // Where the base is stays known; what it does from here on is told in another frame, whose first
  // pose comes next.
  size_ = head_ = 0;
  at_first_.P =
      Eigen::Vector3d(kUnknown_m * kUnknown_m, kUnknown_m * kUnknown_m, 100.0).asDiagonal();
  at_first_.J.setZero();
  at_newest_ = at_first_;
  refused_ = 0;
}

// On the arc between the samples beside it; `before` is the earlier one.
Pose2 WorldFilter::odometry_at(double t, int& before) const noexcept {
  before = size_ - 1;
  while (before > 0 && sample(before).t > t) --before;
  const Sample& a = sample(before);
  if (before + 1 >= size_ || t <= a.t) return a.X_OB;
  const Sample& b = sample(before + 1);
  const double f = (t - a.t) / (b.t - a.t);
  const Pose2 d = compose(inverse(a.X_OB), b.X_OB);
  const double half = 0.5 * d.yaw, k = std::abs(half) < 1e-6 ? 1.0 : half / std::tan(half);
  return compose(a.X_OB, perception::exp_se2(
                             {f * (k * d.x + half * d.y), f * (-half * d.x + k * d.y), f * d.yaw}));
}

// The samples before `t` go; the one at `t` comes first. The error at the first sample is set by
// the caller.
void WorldFilter::drop_until(double t, int before, const Pose2& X_OB) noexcept {
  head_ = (head_ + before) % kSamples;
  size_ -= before;
  samples_[static_cast<std::size_t>(head_)] = {t, X_OB};
}

WorldFilter::Taken WorldFilter::add_camera(double t, const Pose2& X_WB) noexcept {
  if (!std::isfinite(t) || !perception::is_finite(X_WB)) {
    return Taken::kRefused;
  }
  if (size_ == 0 || t > sample(size_ - 1).t) return Taken::kTooNew;
  if (t < sample(0).t || t <= claimed_t_) return Taken::kTooOld;
  int before = 0;
  const Pose2 X_OB = odometry_at(t, before);
  Error e = at_first_;
  for (int i = 0; i < before; ++i) carry(e, sample(i).X_OB, sample(i + 1).X_OB);
  carry(e, sample(before).X_OB, X_OB);

  const Matrix3 P = total(e);
  const Matrix3 S = P + camera_;
  const Matrix3 S_inverse = S.inverse();
  const Pose2 expected = compose(X_WO_, X_OB);
  const Eigen::Vector3d nu = difference(X_WB, expected);
  if (!(nu.dot(S_inverse * nu) <= kGate)) {
    return refuse(t, X_WB, X_OB, std::hypot(nu.x(), nu.y()));
  }
  const Matrix3 K = P * S_inverse;
  const Eigen::Vector3d d = K * nu;
  const Matrix3 I_K = Matrix3::Identity() - K;
  drop_until(t, before, X_OB);
  at_first_.P =
      I_K * P * I_K.transpose() + K * camera_ * K.transpose() + kLeast * Matrix3::Identity();
  set(t, {expected.x + d.x(), expected.y + d.y(), wrap_angle(expected.yaw + d.z())}, X_OB);
  return Taken::kUsed;
}

// The error at the first sample is known: the pose with it, and what was driven since.
void WorldFilter::set(double t, const Pose2& X_WB, const Pose2& X_OB) noexcept {
  X_WO_ = compose(X_WB, inverse(X_OB));
  at_first_.P = (0.5 * (at_first_.P + at_first_.P.transpose())).eval();
  at_first_.J.setZero();
  at_newest_ = at_first_;
  for (int i = 0; i + 1 < size_; ++i) carry(at_newest_, sample(i).X_OB, sample(i + 1).X_OB);
  claimed_t_ = t;
  refused_ = 0;
}

WorldFilter::Taken WorldFilter::refuse(double t, const Pose2& X_WB, const Pose2& X_OB,
                                       double off_m) noexcept {
  bool agrees = false;
  if (refused_ > 0 && t > refused_t_) {
    // What odometry says happened since the last one that was refused, from where that one saw the
    // base.
    const Pose2 expected = compose(refused_X_WB_, compose(inverse(refused_X_OB_), X_OB));
    Error e;
    e.P = camera_;
    const double dx = expected.x - refused_X_WB_.x, dy = expected.y - refused_X_WB_.y;
    carry(e, dx, dy, wrap_angle(expected.yaw - refused_X_WB_.yaw));
    const Eigen::Vector3d nu = difference(X_WB, expected);
    agrees = nu.dot((total(e) + camera_).inverse() * nu) <= kGate;
  }
  refused_ = agrees ? refused_ + 1 : 1;
  refused_t_ = t;
  refused_X_WB_ = X_WB;
  refused_X_OB_ = X_OB;
  off_m_ = off_m;
  if (refused_ < config_.agree) return Taken::kRefused;
  int before = 0;
  (void)odometry_at(t, before);
  drop_until(t, before, X_OB);
  at_first_.P = camera_;
  set(t, X_WB, X_OB);
  return Taken::kRestarted;
}

}  // namespace tasks
