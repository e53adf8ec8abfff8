#include "perception/geometry/pose.hpp"

namespace perception {

// Not in the header: most files include it, and each would take half a second longer to compile,
// for GCC instantiates Eigen's templates of these bodies whether they are used or not.

Pose orthonormalised(const Pose& X) {
  Pose out = X;
  out.linear() = Eigen::Quaterniond(X.linear()).normalized().toRotationMatrix();
  return out;
}

Pose exp_se3(const Eigen::Matrix<double, 6, 1>& xi) {
  const Vec3 w = xi.tail<3>();
  const double angle = w.norm();
  Pose X = Pose::Identity();
  if (angle > 1e-12) X.linear() = Eigen::AngleAxisd(angle, w / angle).toRotationMatrix();
  X.translation() = xi.head<3>();
  return X;
}

double rotation_angle(const Mat3& R) { return Eigen::AngleAxisd(R).angle(); }

Mat3 rotation_about_z(double yaw_rad) noexcept {
  return Eigen::AngleAxisd(yaw_rad, Vec3::UnitZ()).toRotationMatrix();
}

}  // namespace perception
