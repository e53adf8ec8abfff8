#include "perception/segmentation/surface_patches.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "perception/segmentation/lower_median.hpp"

namespace perception {
namespace {

// Pixels, readings, L, a, b, x y z, moments of (x, y, 1) and of 1/z, pixels with colour.
constexpr int kSums = 17;

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
  superpixels_.run(planes, w, h, config.superpixels, lab_.known());
  fit(config.min_readings);
}

void SurfacePatches::halve_depth(ImageView<const std::uint16_t> depth, float mm_per_unit) noexcept {
  const float scale = 1e-3F * mm_per_unit;
  for (int v = 0; v < window_.height; ++v) {
    // A mean would put points between two surfaces.
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
    const std::int32_t* label = labels().data() + static_cast<std::ptrdiff_t>(v) * w;
    // Run by run of one piece's pixels: its sums are fetched and put back once a run.
    for (int u = 0; u < w;) {
      const std::int32_t piece = label[u];
      double c[5] = {0, 0, 0, 0, 0}, r[7] = {0, 0, 0, 0, 0, 0, 0};
      for (; u < w && label[u] == piece; ++u) {
        const int i = v * w + u;
        c[0] += 1;
        if (lab_.coloured(i)) {
          const Lab lab = lab_.at(i);
          c[1] += static_cast<double>(lab.L);
          c[2] += static_cast<double>(lab.a);
          c[3] += static_cast<double>(lab.b);
          c[4] += 1;
        }
        const auto z = static_cast<double>(z_[static_cast<std::size_t>(i)]);
        if (!(z > 0)) continue;
        const auto x = static_cast<double>(x_of(u));
        const double q = 1 / z;
        r[0] += 1;
        r[1] += x * z;
        r[2] += z;
        r[3] += x * x;
        r[4] += x;
        r[5] += x * q;
        r[6] += q;
      }
      double* s = &sums_[static_cast<std::size_t>(piece * kSums)];
      s[0] += c[0];
      s[1] += r[0];
      for (int k = 0; k < 3; ++k) s[2 + k] += c[1 + k];
      s[5] += r[1];
      s[6] += y * r[2];
      s[7] += r[2];
      s[8] += r[3];
      s[9] += y * r[4];
      s[10] += r[4];
      s[11] += y * y * r[0];
      s[12] += y * r[0];
      s[13] += r[5];
      s[14] += y * r[6];
      s[15] += r[6];
      s[16] += c[4];
    }
  }
  for (int k = 0; k < count(); ++k) {
    const double* s = &sums_[static_cast<std::size_t>(k * kSums)];
    SurfacePiece& p = pieces_[static_cast<std::size_t>(k)];
    p = {};
    p.pixels = static_cast<int>(s[0]);
    p.readings = static_cast<int>(s[1]);
    p.coloured = static_cast<int>(s[16]);
    if (p.coloured > 0) {
      p.L = static_cast<float>(s[2] / s[16]);
      p.a = static_cast<float>(s[3] / s[16]);
      p.b = static_cast<float>(s[4] / s[16]);
    }
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
