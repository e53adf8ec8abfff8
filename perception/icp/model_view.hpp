// What the tracker aligns a new frame to: one surface point and one normal a pixel, interleaved so
// that a lookup touches one 16-byte record.
//
// Record of pixel (u, v): nx, ny, nz, depth (floats, m), row-major, in the frame F of the camera
// that cast the map. The vertex is the point at that depth that pixel (u, v) of its intrinsics
// sees. Normals are unit and point towards the camera. No surface: all four are 0. The layout of
// perception/raycast.
#pragma once

#include <cstddef>

#include "perception/geometry/camera_model.hpp"

namespace perception {

inline constexpr int kModelStride = 4;  // floats a pixel

struct ModelView {
  const float* data = nullptr;   // 64-byte aligned is fastest; not required
  Intrinsics intrinsics{};       // of the map; its width and height give the extent
  Pose X_WF = Pose::Identity();  // of the casting camera

  [[nodiscard]] bool valid() const noexcept { return data != nullptr && intrinsics.valid(); }
  [[nodiscard]] const float* at(int u, int v) const noexcept {
    return data + kModelStride * (static_cast<std::ptrdiff_t>(v) * intrinsics.width + u);
  }
};

}  // namespace perception
