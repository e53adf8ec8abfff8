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
[[nodiscard]] Pose orthonormalised(const Pose& X);

// exp of a twist (v, w): translation first, rotation vector second, both in the target frame.
[[nodiscard]] Pose exp_se3(const Eigen::Matrix<double, 6, 1>& xi);

// rad, 0 to pi: how far R turns.
[[nodiscard]] double rotation_angle(const Mat3& R);

// R_AB of a B that is turned to the left by yaw_rad, seen from above A (z up).
[[nodiscard]] Mat3 rotation_about_z(double yaw_rad) noexcept;

}  // namespace perception
