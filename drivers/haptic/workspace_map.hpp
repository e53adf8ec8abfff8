// Where the device's workspace lies in the scene: p_WH = p_WD + scale * Rz(yaw) * p_DH.
// The same mapping as the haptic task's; scale is scene metres per hand metre.
#pragma once

#include <cmath>

#include "perception/geometry/pose.hpp"

namespace drivers {

class WorkspaceMap {
 public:
  WorkspaceMap() = default;
  WorkspaceMap(const perception::Vec3& p_WD, double scale, double yaw_rad)
      : p_WD_(p_WD), scale_(scale), R_WD_(perception::rotation_about_z(yaw_rad)) {}

  [[nodiscard]] perception::Vec3 to_world(const perception::Vec3& p_DH) const noexcept {
    return p_WD_ + R_WD_ * (scale_ * p_DH);
  }
  [[nodiscard]] perception::Vec3 to_device(const perception::Vec3& p_WH) const noexcept {
    return R_WD_.transpose() * (p_WH - p_WD_) / scale_;
  }
  [[nodiscard]] perception::Vec3 direction_to_device(const perception::Vec3& d_W) const noexcept {
    return R_WD_.transpose() * d_W;
  }
  [[nodiscard]] double scale() const noexcept { return scale_; }

 private:
  perception::Vec3 p_WD_ = perception::Vec3::Zero();
  double scale_ = 1.0;
  perception::Mat3 R_WD_ = perception::Mat3::Identity();
};

}  // namespace drivers
