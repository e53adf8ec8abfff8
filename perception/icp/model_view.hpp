// What the tracker aligns a new frame to: one vertex and one normal a pixel, interleaved so that a
// lookup touches one 32-byte record.
//
// Record of pixel (u, v): x, y, z, unused, nx, ny, nz, unused (floats, m), row-major, in the frame F of
// the camera that cast the map: pixel (u, v) of its intrinsics sees its vertex. Normals are unit and
// point towards the camera. No surface: the normal is (0, 0, 0). The layout of perception/raycast.
#pragma once

#include <cstddef>

#include "perception/geometry/camera_model.hpp"

namespace perception {

inline constexpr int kModelStride = 8;  // floats a pixel

struct ModelView {
  const float* data = nullptr;   // 32-byte aligned is fastest; not required
  Intrinsics intrinsics{};       // of the map; its width and height give the extent
  Pose X_WF = Pose::Identity();  // of the casting camera

  [[nodiscard]] bool valid() const noexcept { return data != nullptr && intrinsics.valid(); }
  [[nodiscard]] const float* at(int u, int v) const noexcept {
    return data + kModelStride * (static_cast<std::ptrdiff_t>(v) * intrinsics.width + u);
  }
};

}  // namespace perception
