#include "perception/segmentation/surface_patches.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

namespace perception {
namespace {

constexpr int kSums = 16;  // pixels, readings, L, a, b, x y z, moments of (x, y, 1) and of 1/z

// Of the readings in 2 x 2 pixels the lower median: a mean would put points between two surfaces.
std::uint16_t lower_median(const std::array<std::uint16_t, 4>& readings) noexcept {
  std::uint16_t sorted[4];
  int n = 0;
  for (const std::uint16_t r : readings) {
    if (r == 0 || r == 65535) continue;
    int k = n++;
    for (; k > 0 && sorted[k - 1] > r; --k) sorted[k] = sorted[k - 1];
    sorted[k] = r;
  }
  return n == 0 ? std::uint16_t{0} : sorted[(n - 1) / 2];
}

}  // namespace

SurfacePatches::SurfacePatches(int max_width, int max_height)
    : lab_((max_width + 1) / 2, (max_height + 1) / 2),
      superpixels_((max_width + 1) / 2, (max_height + 1) / 2) {
  const auto w = static_cast<std::size_t>((max_width + 1) / 2);
  const auto h = static_cast<std::size_t>((max_height + 1) / 2);
  z_.resize(w * h);
  inverse_.resize(w * h);
  light_.resize(w * h);
  x_.resize(w);
  y_.resize(h);
  pieces_.resize(w * h);
  sums_.resize(w * h * kSums);
}

void SurfacePatches::set(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                         const Intrinsics& k, float mm_per_unit, const HalfWindow& window,
                         const PatchesConfig& config) noexcept {
  window_ = window;
  const int w = window.width, h = window.height;
  const auto at = [&](auto image) {
    image.data += static_cast<std::ptrdiff_t>(2 * window.v0) * image.stride + 2 * window.u0;
    image.width = 2 * w;
    image.height = 2 * h;
    return image;
  };
  lab_.set_half(at(rgb));
  halve_depth(at(depth), mm_per_unit);
  x_step_ = static_cast<float>(2.0 / k.fx);
  y_step_ = static_cast<float>(2.0 / k.fy);
  for (int u = 0; u < w; ++u) {
    x_[static_cast<std::size_t>(u)] =
        static_cast<float>((2.0 * (window.u0 + u) + 0.5 - k.cx) / k.fx);
  }
  for (int v = 0; v < h; ++v) {
    y_[static_cast<std::size_t>(v)] =
        static_cast<float>((2.0 * (window.v0 + v) + 0.5 - k.cy) / k.fy);
  }
  fill_inverse(config.inverse_depth_weight);
  for (int i = 0; i < w * h; ++i) {
    light_[static_cast<std::size_t>(i)] = config.light_weight * lab_.plane(0)[i];
  }
  const float* const planes[] = {light_.data(), lab_.plane(1), lab_.plane(2), inverse_.data()};
  superpixels_.run(planes, w, h, config.superpixels);
  fit(config.min_readings);
}

void SurfacePatches::halve_depth(ImageView<const std::uint16_t> depth, float mm_per_unit) noexcept {
  const float scale = 1e-3F * mm_per_unit;
  for (int v = 0; v < window_.height; ++v) {
    const std::uint16_t *p = depth.row(2 * v), *q = depth.row(2 * v + 1);
    for (int u = 0; u < window_.width; ++u, p += 2, q += 2) {
      z_[static_cast<std::size_t>(v * window_.width + u)] =
          scale * static_cast<float>(lower_median({p[0], p[1], q[0], q[1]}));
    }
  }
}

// Inverse depth for the superpixels; a hole takes the farther of its two ends in the row, for most
// holes are shadows behind an edge.
void SurfacePatches::fill_inverse(float weight) noexcept {
  const int w = window_.width;
  for (int v = 0; v < window_.height; ++v) {
    const float* z = &z_[static_cast<std::size_t>(v * w)];
    float* q = &inverse_[static_cast<std::size_t>(v * w)];
    float left = 0;
    for (int u = 0; u < w;) {
      if (z[u] > 0) {
        left = q[u] = weight / z[u];
        ++u;
        continue;
      }
      int end = u;
      while (end < w && !(z[end] > 0)) ++end;
      const float right = end < w ? weight / z[end] : left;
      const float fill = left > 0 ? std::min(left, right) : right;
      for (; u < end; ++u) q[u] = fill;
    }
  }
}

void SurfacePatches::fit(float min_readings) noexcept {
  std::fill_n(sums_.begin(), count() * kSums, 0.0);
  const int w = window_.width;
  for (int v = 0; v < window_.height; ++v) {
    const auto y = static_cast<double>(y_of(v));
    for (int u = 0; u < w; ++u) {
      const int i = v * w + u;
      double* s = &sums_[static_cast<std::size_t>(labels()[static_cast<std::size_t>(i)] * kSums)];
      const Lab c = lab_.at(i);
      s[0] += 1;
      s[2] += static_cast<double>(c.L);
      s[3] += static_cast<double>(c.a);
      s[4] += static_cast<double>(c.b);
      const auto z = static_cast<double>(z_[static_cast<std::size_t>(i)]);
      if (!(z > 0)) continue;
      const auto x = static_cast<double>(x_of(u));
      const double q = 1 / z;
      s[1] += 1;
      s[5] += x * z;
      s[6] += y * z;
      s[7] += z;
      s[8] += x * x;
      s[9] += x * y;
      s[10] += x;
      s[11] += y * y;
      s[12] += y;
      s[13] += x * q;
      s[14] += y * q;
      s[15] += q;
    }
  }
  for (int k = 0; k < count(); ++k) {
    const double* s = &sums_[static_cast<std::size_t>(k * kSums)];
    SurfacePiece& p = pieces_[static_cast<std::size_t>(k)];
    p = {};
    p.pixels = static_cast<int>(s[0]);
    p.readings = static_cast<int>(s[1]);
    p.L = static_cast<float>(s[2] / s[0]);
    p.a = static_cast<float>(s[3] / s[0]);
    p.b = static_cast<float>(s[4] / s[0]);
    if (s[1] < 6 || s[1] < static_cast<double>(min_readings) * s[0]) continue;
    const double n = s[1];
    p.centre = Vec3(s[5] / n, s[6] / n, s[7] / n).cast<float>();
    // About the mean, so that the two slopes are a well-scaled 2 x 2 system.
    const double mx = s[10] / n, my = s[12] / n, mq = s[15] / n;
    const double xx = s[8] / n - mx * mx, xy = s[9] / n - mx * my, yy = s[11] / n - my * my;
    const double xq = s[13] / n - mx * mq, yq = s[14] / n - my * mq;
    const double det = xx * yy - xy * xy;
    if (!(det > 1e-3 * xx * yy) || !(xx * yy > 0)) continue;
    const double a = (yy * xq - xy * yq) / det, b = (xx * yq - xy * xq) / det;
    const Vec3 plane(a, b, mq - a * mx - b * my);
    const double length = plane.norm();
    if (!(length > 1e-9) || !std::isfinite(length)) continue;
    p.w = plane.cast<float>();
    p.normal = (plane * (-1 / length)).cast<float>();
  }
}

}  // namespace perception
