// Pinhole camera, pixel centres at integer coordinates, optical frame C: x right, y down, z
// forward.
#pragma once

#include "perception/geometry/pose.hpp"

namespace perception {

struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;  // px
  int width = 0, height = 0;              // px

  [[nodiscard]] bool valid() const noexcept { return fx > 0 && fy > 0 && width > 0 && height > 0; }
  // Point at depth z (along the optical axis, m) seen by pixel (u, v).
  [[nodiscard]] Vec3 unproject(double u, double v, double z) const noexcept {
    return {(u - cx) * z / fx, (v - cy) * z / fy, z};
  }
  [[nodiscard]] Eigen::Vector2d project(const Vec3& p_C) const noexcept {
    return {fx * p_C.x() / p_C.z() + cx, fy * p_C.y() / p_C.z() + cy};
  }
  // The camera that sees every `step`-th pixel (0, step, 2 step, ...).
  [[nodiscard]] Intrinsics subsampled(int step) const noexcept {
    return {fx / step,
            fy / step,
            cx / step,
            cy / step,
            (width + step - 1) / step,
            (height + step - 1) / step};
  }
  friend bool operator==(const Intrinsics&, const Intrinsics&) = default;
};

}  // namespace perception
