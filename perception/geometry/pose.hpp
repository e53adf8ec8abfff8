// Rigid transforms. X_AB maps coordinates in B to coordinates in A; inner letters cancel:
// X_WC = X_WB * X_BC. Frames are drawn in docs/frames.md.
#pragma once

#include <Eigen/Geometry>

namespace perception {

using Vec3 = Eigen::Vector3d;
using Vec3f = Eigen::Vector3f;
using Mat3 = Eigen::Matrix3d;
using Pose = Eigen::Isometry3d;

// Nearest rotation; call once a frame so that products of poses stay rigid.
[[nodiscard]] inline Pose orthonormalised(const Pose& X) {
  Pose out = X;
  out.linear() = Eigen::Quaterniond(X.linear()).normalized().toRotationMatrix();
  return out;
}

// exp of a twist (v, w): translation first, rotation vector second, both in the target frame.
[[nodiscard]] inline Pose exp_se3(const Eigen::Matrix<double, 6, 1>& xi) {
  const Vec3 w = xi.tail<3>();
  const double angle = w.norm();
  Pose X = Pose::Identity();
  if (angle > 1e-12) X.linear() = Eigen::AngleAxisd(angle, w / angle).toRotationMatrix();
  X.translation() = xi.head<3>();
  return X;
}

[[nodiscard]] inline double rotation_angle(const Mat3& R) { return Eigen::AngleAxisd(R).angle(); }

}  // namespace perception
