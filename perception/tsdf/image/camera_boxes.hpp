// One frame's camera as the stages of integration and the readers see it: projections of boxes,
// conservative.
#pragma once

#include <cmath>
#include <cstdint>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/tsdf/image/frame_view.hpp"

namespace perception {

struct BoxView {
  float z_near, z_far;  // of the box along the optical axis
  int u0, v0, u1, v1;   // pixels its points may fall on, clipped to the image
  bool visible;         // some point may project into the image
  bool inside;          // every point projects into the image
};

class CameraBoxes {
 public:
  CameraBoxes(const Intrinsics& k, const Pose& X_CW) noexcept
      : fx_(static_cast<float>(k.fx)),
        fy_(static_cast<float>(k.fy)),
        cx_(static_cast<float>(k.cx)),
        cy_(static_cast<float>(k.cy)),
        width_(k.width),
        height_(k.height) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) R_[r][c] = X_CW.linear()(r, c);
      t_[r] = X_CW.translation()(r);
      spread_[r] =
          static_cast<float>(std::fabs(R_[r][0]) + std::fabs(R_[r][1]) + std::fabs(R_[r][2]));
    }
  }

  // A world-aligned cube by centre and half edge, m.
  [[nodiscard]] BoxView view(double x, double y, double z, float half) const noexcept {
    BoxView b{};
    float c[3];
    for (int r = 0; r < 3; ++r)
      c[r] = static_cast<float>(R_[r][0] * x + R_[r][1] * y + R_[r][2] * z + t_[r]);
    // 1e-5 m covers the float arithmetic here and in the voxel loop.
    const float hx = half * spread_[0] + 1e-5F, hy = half * spread_[1] + 1e-5F;
    const float hz = half * spread_[2] + 1e-5F;
    b.z_near = c[2] - hz, b.z_far = c[2] + hz;
    if (b.z_far < kLeastZ) return b;
    if (b.z_near < kLeastZ) {  // reaches the image plane: could be anywhere
      b.visible = true;
      b.u1 = width_ - 1, b.v1 = height_ - 1;
      return b;
    }
    const float in = 1.0F / b.z_near, iz = 1.0F / b.z_far;
    const float xl = c[0] - hx, xh = c[0] + hx, yl = c[1] - hy, yh = c[1] + hy;
    const float ul = fx_ * xl * (xl < 0 ? in : iz) + cx_, uh = fx_ * xh * (xh < 0 ? iz : in) + cx_;
    const float vl = fy_ * yl * (yl < 0 ? in : iz) + cy_, vh = fy_ * yh * (yh < 0 ? iz : in) + cy_;
    const auto w = static_cast<float>(width_) - 0.5F, h = static_cast<float>(height_) - 0.5F;
    if (uh < -kSlack - 0.5F || vh < -kSlack - 0.5F || ul > w + kSlack || vl > h + kSlack) return b;
    b.visible = true;
    b.inside = ul >= kSlack - 0.5F && vl >= kSlack - 0.5F && uh < w - kSlack && vh < h - kSlack;
    const float top_u = static_cast<float>(width_ - 1), top_v = static_cast<float>(height_ - 1);
    b.u0 = static_cast<int>(clamp(ul + 0.5F - kSlack, 0.0F, top_u));
    b.v0 = static_cast<int>(clamp(vl + 0.5F - kSlack, 0.0F, top_v));
    b.u1 = static_cast<int>(clamp(uh + 0.5F + kSlack, 0.0F, top_u));
    b.v1 = static_cast<int>(clamp(vh + 0.5F + kSlack, 0.0F, top_v));
    return b;
  }

  static constexpr float kLeastZ = 0.05F;

 private:
  static constexpr float kSlack = 0.01F;  // px
  static float clamp(float v, float lo, float hi) noexcept { return v < lo ? lo : v > hi ? hi : v; }
  float fx_, fy_, cx_, cy_;
  int width_, height_;
  double R_[3][3], t_[3];
  float spread_[3];
};

// A frame with where it was taken from. X_WC: camera (optical frame) in the world.
struct FrameCamera {
  const FrameView& frame;
  Pose X_WC, X_CW;
  CameraBoxes boxes;
};

}  // namespace perception
