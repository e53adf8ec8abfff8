// What a camera at X_WC sees of the map: for each ray the first crossing from outside (+) to inside
// (-) beyond the least depth, refined on the trilinear field. Unknown nodes are never crossed into
// a surface: both sides of a crossing are known.
//
// Frame     vertices and normals in the frame C of the casting camera, m; normals unit, towards the
//           camera.
// Records   nx, ny, nz, depth a pixel (the layout of perception/icp/model_view.hpp); no surface:
//           all four are 0.
// Method    per-tile depth bounds from the blocks in view, absent chunks and blocks skipped whole,
//           steps by the stored distance, then secant on trilinear values.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/tsdf/blocks/chunk_directory.hpp"
#include "perception/tsdf/blocks/map_view.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

struct RaycastOptions {
  int pixel_step = 1;        // rays of pixels 0, step, 2 step, ...
  double min_depth_m = 0.1;  // along the optical axis
  double max_depth_m = 6.0;
  double min_weight = 1.0;  // observations of every corner used
  bool colour = false;
  // MapReader::label() of the hit; labelled surfaces are continued to their outlines, in the
  // records too (raycast_labels.cpp).
  bool labels = false;
  // Normals from three voxels round the hit (averages the field's noise) instead of from the cell
  // that holds it.
  bool smooth_normals = true;
  // Tracking only: depth of the image, m, at full resolution or at that of the rays. 0: no hint;
  // below 0: nothing is to be seen there. A ray with a hint takes the crossing next to the hint,
  // within one truncation. If there is none it takes the first crossing from 1.1 truncation in
  // front of the hint, so it passes surfaces that lie farther before the hint.
  ImageView<const float> hint_depth_m{};
  // With a hint image: what the hint does not settle, and rays without one, see nothing.
  bool hinted_only = false;
  // Threads that take part; the bytes are the same for any number.
  rt::ForkJoin* crew = &rt::serial();
};

struct RaycastStats {
  std::int32_t rays = 0, hits = 0;
  std::int64_t steps = 0;  // deterministic work count
};

class RaycastMaps {
 public:
  static constexpr int kStride = 4;
  // Room for width x height rays.
  RaycastMaps(rt::NonRealtime&, int width, int height);

  Intrinsics intrinsics{};  // of the maps: the casting camera, subsampled
  Pose X_WC = Pose::Identity();

  [[nodiscard]] int width() const noexcept { return intrinsics.width; }
  [[nodiscard]] int height() const noexcept { return intrinsics.height; }
  [[nodiscard]] bool fits(int width, int height) const noexcept {
    const auto w = static_cast<std::size_t>(width), h = static_cast<std::size_t>(height);
    return w * h <= capacity_ && ((w + 3) / 4) * ((h + 3) / 4) <= near_m_.size();
  }
  [[nodiscard]] const float* data() const noexcept { return records_; }
  [[nodiscard]] float* data() noexcept { return records_; }
  [[nodiscard]] const float* at(int u, int v) const noexcept {
    return records_ + kStride * (static_cast<std::ptrdiff_t>(v) * intrinsics.width + u);
  }
  [[nodiscard]] bool hit(int u, int v) const noexcept { return at(u, v)[3] > 0; }
  [[nodiscard]] Vec3f vertex_C(int u, int v) const noexcept {
    const float z = at(u, v)[3];
    return {static_cast<float>((u - intrinsics.cx) / intrinsics.fx) * z,
            static_cast<float>((v - intrinsics.cy) / intrinsics.fy) * z, z};
  }
  [[nodiscard]] Vec3f normal_C(int u, int v) const noexcept { return Vec3f(at(u, v)); }
  // Filled when options.colour; mid grey where the map has none.
  [[nodiscard]] ImageView<const Rgb> colour() const noexcept {
    return {colour_.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }

  // Filled when options.labels; 0 where the map has none, and where nothing was hit.
  [[nodiscard]] ImageView<const std::uint8_t> labels() const noexcept {
    return {labels_.data(), intrinsics.width, intrinsics.height, intrinsics.width};
  }

 private:
  friend class Caster;
  friend RaycastStats raycast(const MapView&, const Intrinsics&, const Pose&, const RaycastOptions&,
                              RaycastMaps&) noexcept;
  void find_labels(const MapView& map) noexcept;
  void continue_outlines(const MapView& map) noexcept;
  ChunkDirectory directory_;
  std::size_t capacity_ = 0;
  std::vector<float> storage_;
  float* records_ = nullptr;  // 64-byte aligned into storage_
  std::vector<Rgb> colour_;
  std::vector<std::uint8_t> labels_;
  std::vector<float> near_m_, far_m_;  // per tile of 4 x 4 rays
  std::vector<float> x_;               // (u - cx) / fx of a column
};

// `camera` is the full-resolution camera. When the maps are too small for the rays, or the pose is
// not finite, nothing is cast and stats.rays is 0 (the maps then hold 0 x 0 rays).
RaycastStats raycast(const MapView& map, const Intrinsics& camera, const Pose& X_WC,
                     const RaycastOptions& options, RaycastMaps& out) noexcept;

}  // namespace perception
