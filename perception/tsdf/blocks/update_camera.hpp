// Input of the block kernels: the camera that blocks are projected into, and a block's place before
// it.
#pragma once

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/kernels/voxel_update.hpp"

namespace perception {

// For the image in the pyramid, which must outlive the result; without colour.
[[nodiscard]] UpdateCamera update_camera(const MapStore& store, const DepthPyramid& pyramid,
                                         const Intrinsics& k, const Pose& X_CW) noexcept;

// The block's first node in the camera frame, m.
inline void first_node_C(const Pose& X_CW, double voxel, BlockCoord at, float (&p0)[3]) noexcept {
  const Vec3 first_C = X_CW * (voxel * Vec3(8.0 * at.x, 8.0 * at.y, 8.0 * at.z));
  for (int a = 0; a < 3; ++a) p0[a] = static_cast<float>(first_C(a));
}

}  // namespace perception
