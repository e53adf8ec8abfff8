// From a depth image to what tracking needs: filtered depth, a 3-level pyramid, normals.
//
// Every step refuses to mix two surfaces: neighbours count in point-symmetric pairs (so a slanted
// plane is not biased at its border), only when both differ from the centre by less than the depth
// edge of the EdgeRule (noise grows with z^2, a slope with the size of a pixel), and a missing
// reading (0) never counts. Borders are padded with "no reading". Sources: bilateral filter, Tomasi
// and Manduchi 1998, with a compact range kernel (1 - (d/edge)^2)^2 in place of a Gaussian, so that
// beyond the edge the weight is exactly 0; pyramid and normals, Newcombe et al., KinectFusion 2011.
//
// Same bytes on every instruction set: fixed lane order, no contraction. Nothing here allocates
// after construction.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/icp/kernels.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

struct PreprocessConfig {
  double depth_min_m = 0.3;     // nearer readings are dropped
  double depth_max_m = 5.0;     // farther ones too
  int bilateral_radius_px = 2;  // 0 switches the filter off
  double bilateral_sigma_px = 1.5;
  double edge_base_m = 0.02;   // depth step that is an edge, at depth 0 ...
  double edge_per_m2 = 0.006;  // ... plus this much times depth squared ...
  double edge_slope = 2.0;     // ... plus what a surface of this slope (dz/dx) changes in a pixel
  void describe(config::Section& s);
};

// A float image with a margin of zeros on all sides, rows 32-byte aligned, so that filters need no
// border branch. The shape may shrink below the constructed one, never grow.
class PaddedImage {
 public:
  static constexpr int kMargin = 8;
  PaddedImage() = default;
  PaddedImage(int max_width, int max_height);
  void reshape(int width, int height) noexcept;  // clears the margins, leaves the inside undefined
  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  [[nodiscard]] int stride() const noexcept { return stride_; }
  [[nodiscard]] float* row(int v) noexcept {
    return data_.data() + origin_ + static_cast<std::ptrdiff_t>(v) * stride_;
  }
  [[nodiscard]] const float* row(int v) const noexcept {
    return data_.data() + origin_ + static_cast<std::ptrdiff_t>(v) * stride_;
  }

 private:
  int width_ = 0, height_ = 0, stride_ = 0, max_width_ = 0, max_height_ = 0;
  std::ptrdiff_t origin_ = 0;
  std::vector<float> data_;
};

// One pyramid level, seen by camera `intrinsics`: depth (m, 0 = none) and unit normals in the
// camera frame, towards the camera; (0, 0, 0) = none. The vertex of a pixel is depth * (x_factor,
// y_factor, 1).
struct DepthLevel {
  Intrinsics intrinsics{};
  PaddedImage depth, nx, ny, nz;
  std::vector<float> x_factor;  // (u - cx) / fx, padded by 8 entries
  std::vector<float> y_factor;
  int valid = 0;  // pixels with depth; counted at level 1 only
};

class TrackingPyramid {
 public:
  static constexpr int kLevels = 3;
  TrackingPyramid(rt::NonRealtime&, const PreprocessConfig& config, int max_width, int max_height);

  // Fills all levels from a raw image. `pixel_step` 1, 2 or 4: level 0 is the camera that sees
  // every pixel_step-th pixel (edge-aware half-sampling), level l every pixel_step * 2^l-th.
  void build(ImageView<const std::uint16_t> depth_mm, const Intrinsics& intrinsics, int pixel_step,
             rt::ForkJoin& crew = rt::serial()) noexcept;

  // Takes the pixels that are not 0 in `mask`, of the size of level `l`, out of all levels.
  void drop(ImageView<const std::uint8_t> mask, int l) noexcept;

  [[nodiscard]] const DepthLevel& level(int l) const noexcept {
    return levels_[static_cast<std::size_t>(l)];
  }
  [[nodiscard]] int pixel_step() const noexcept { return pixel_step_; }
  // The unfiltered image in metres at full resolution, 0 = no reading.
  [[nodiscard]] ImageView<const float> full_depth() const noexcept {
    return {raw_.row(0), raw_.width(), raw_.height(), raw_.stride()};
  }
  // Mean depth of the coarsest level, m, as readings weigh; 0 when the image
  // holds no reading.
  [[nodiscard]] double mean_depth(const icp::NoiseRule& noise) const noexcept;
  // Pixels visited by the last build(); a function of the input alone.
  [[nodiscard]] std::uint64_t work() const noexcept { return work_; }

 private:
  [[nodiscard]] icp::EdgeRule edge_rule(double focal_px) const noexcept;
  PreprocessConfig config_;
  std::array<DepthLevel, kLevels> levels_;
  PaddedImage raw_, half_, quarter_;
  std::vector<float> spatial_weight_;
  int pixel_step_ = 1;
  std::uint64_t work_ = 0;
};

// The single steps, for tests and for reuse.
void depth_to_metres(ImageView<const std::uint16_t> depth_mm, float min_m, float max_m,
                     PaddedImage& out) noexcept;
// weights: bilateral_weights() of the same radius.
void bilateral(const PaddedImage& in, const std::vector<float>& weights, int radius,
               const icp::EdgeRule& rule, PaddedImage& out) noexcept;
// Half resolution, samples at even pixels: mean of the 3x3 window.
void half_sample(const PaddedImage& in, const icp::EdgeRule& rule, PaddedImage& out) noexcept;
void normals(DepthLevel& level, const icp::EdgeRule& rule) noexcept;
// Of the centre, then of one half plane: (1..r, 0), then rows 1..r from -r to r.
[[nodiscard]] std::vector<float> bilateral_weights(int radius, double sigma_px);

}  // namespace perception
