// One RGB-D frame, or a window of it, as small surface pieces: half-resolution colour and points,
// superpixels over colour and inverse depth, a plane through each.
//
// A plane is linear in inverse depth: 1/z = w . (x, y, 1) with (x, y) the normalised image point
// and w = n / d for the plane n . p = d, so each piece takes one 3 x 3 least-squares solve, in the
// quantity whose noise is even over the image for a triangulating sensor.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/segmentation/lab.hpp"
#include "perception/segmentation/superpixels.hpp"

namespace perception {

struct PatchesConfig {
  SuperpixelConfig superpixels{
      // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
      .spacing_px = 6,
      .compactness = 10,
      .iterations = 4,
      .reach_divisor = 2,
      .min_share = 0.25F};
  float light_weight = 0.6F;         // of L in the superpixels' distance
  float inverse_depth_weight = 400;  // Lab units per 1/m
  float min_readings = 0.3F;         // share of a piece's pixels, below it has no plane
};

// Half-resolution window: pixel (u, v) covers full pixels 2(u0 + u) .. +1, 2(v0 + v) .. +1.
struct HalfWindow {
  int u0 = 0, v0 = 0, width = 0, height = 0;
};

struct SurfacePiece {
  int pixels = 0, readings = 0, coloured = 0;
  float L = 0, a = 0, b = 0;  // of the pixels that have colour
  Vec3f centre{0, 0, 0};      // mean of its points, camera frame C, m
  Vec3f normal{0, 0, 0};      // unit, towards the camera; zero without a plane
  Vec3f w{0, 0, 0};           // 1/z = w . (x, y, 1), 1/m
  [[nodiscard]] bool has_plane() const noexcept { return w.squaredNorm() > 0; }
};

class SurfacePatches {
 public:
  SurfacePatches(int max_width, int max_height);  // of the full image

  // Does not allocate. depth in units of mm_per_unit; 0 and 65535 are no reading.
  void set(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, const Intrinsics& k,
           float mm_per_unit, const HalfWindow& window, const PatchesConfig& config) noexcept;

  [[nodiscard]] const HalfWindow& window() const noexcept { return window_; }
  [[nodiscard]] const LabImage& lab() const noexcept { return lab_; }
  // m along the optical axis, 0 = no reading.
  [[nodiscard]] const std::vector<float>& z_m() const noexcept { return z_; }
  [[nodiscard]] const std::vector<std::int32_t>& labels() const noexcept {
    return superpixels_.labels();
  }
  [[nodiscard]] int count() const noexcept { return superpixels_.count(); }
  [[nodiscard]] const SurfacePiece& piece(int i) const noexcept {
    return pieces_[static_cast<std::size_t>(i)];
  }
  // Normalised image point of a window pixel: (x, y, 1) z is the point in C.
  [[nodiscard]] float x_of(int u) const noexcept { return x_[static_cast<std::size_t>(u)]; }
  [[nodiscard]] float y_of(int v) const noexcept { return y_[static_cast<std::size_t>(v)]; }
  // From one window pixel to the next.
  [[nodiscard]] float x_step() const noexcept { return x_step_; }
  [[nodiscard]] float y_step() const noexcept { return y_step_; }
  [[nodiscard]] Vec3f point(int u, int v) const noexcept {
    const float z = z_[static_cast<std::size_t>(v * window_.width + u)];
    return {x_of(u) * z, y_of(v) * z, z};
  }

 private:
  void halve_depth(ImageView<const std::uint16_t> depth, float mm_per_unit) noexcept;
  void fill_inverse(float weight) noexcept;
  void fit(float min_readings) noexcept;

  HalfWindow window_;
  LabImage lab_;
  Superpixels superpixels_;
  std::vector<float> z_, inverse_, light_, x_, y_;
  float x_step_ = 0, y_step_ = 0;
  std::vector<SurfacePiece> pieces_;
  std::vector<double> sums_;
};

}  // namespace perception
