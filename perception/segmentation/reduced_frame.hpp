// A part of a frame at a half or a quarter of its resolution, for objects that fill the image: what
// a voxel map can hold of an outline does not need every pixel of them.
//
// Pixel (u, v) covers full pixels s u .. s u + s - 1. Its colour is the mean of those that have
// one, its reading the lower median of the four in their middle: a mean would put points between
// two surfaces.
#pragma once

#include <cstdint>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace perception {

class ReducedFrame {
 public:
  ReducedFrame(int max_width, int max_height);  // of the full image

  // Pixels (u0, v0) to (u1, v1) of the reduced image, inclusive, clipped to it; the rest is left as
  // it was. scale 2 or 4. Does not allocate.
  void set(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, const Intrinsics& k,
           int scale, int u0, int v0, int u1, int v1) noexcept;

  [[nodiscard]] ImageView<const Rgb> colour() const noexcept { return rgb_.view(); }
  [[nodiscard]] ImageView<const std::uint16_t> depth() const noexcept { return depth_.view(); }
  [[nodiscard]] const Intrinsics& intrinsics() const noexcept { return intrinsics_; }

 private:
  Image<Rgb> rgb_;
  Image<std::uint16_t> depth_;
  Intrinsics intrinsics_{};
};

}  // namespace perception
