#include "perception/segmentation/surface_patches.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "perception/segmentation/lower_median.hpp"

namespace perception {
namespace {

// Pixels, readings, L, a, b, x y z, moments of (x, y, 1) and of 1/z, pixels with colour.
constexpr int kPieceSums = 17;

// Of a run of one piece's pixels in a row: a piece's sums are fetched and put back once a run.
struct RunSums {
  double pixels = 0, readings = 0, coloured = 0;
  double L = 0, a = 0, b = 0;
  double xz = 0, z = 0, xx = 0, x = 0, xq = 0, q = 0;  // q = 1 / z

  void add(const Lab& lab) noexcept {
    L += static_cast<double>(lab.L);
    a += static_cast<double>(lab.a);
    b += static_cast<double>(lab.b);
    coloured += 1;
  }
  void add(double x_, double z_) noexcept {
    const double q_ = 1 / z_;
    readings += 1;
    xz += x_ * z_;
    z += z_;
    xx += x_ * x_;
    x += x_;
    xq += x_ * q_;
    q += q_;
  }
  // Into the sums of the piece, for the row at `y`.
  void put(double y, double* s) const noexcept {
    s[0] += pixels;
    s[1] += readings;
    s[2] += L;
    s[3] += a;
    s[4] += b;
    s[5] += xz;
    s[6] += y * z;
    s[7] += z;
    s[8] += xx;
    s[9] += y * x;
    s[10] += x;
    s[11] += y * y * readings;
    s[12] += y * readings;
    s[13] += xq;
    s[14] += y * q;
    s[15] += q;
    s[16] += coloured;
  }
};

// Mean colour, centre and plane of a piece from its sums; without enough readings no plane.
SurfacePiece piece_of(const double* s, float min_readings) noexcept {
  SurfacePiece p;
  p.pixels = static_cast<int>(s[0]);
  p.readings = static_cast<int>(s[1]);
  p.coloured = static_cast<int>(s[16]);
  if (p.coloured > 0) {
    p.L = static_cast<float>(s[2] / s[16]);
    p.a = static_cast<float>(s[3] / s[16]);
    p.b = static_cast<float>(s[4] / s[16]);
  }
  if (s[1] < 6 || s[1] < static_cast<double>(min_readings) * s[0]) return p;
  const double n = s[1];
  p.centre = Vec3(s[5] / n, s[6] / n, s[7] / n).cast<float>();
  // About the mean, so that the two slopes are a well-scaled 2 x 2 system.
  const double mx = s[10] / n, my = s[12] / n, mq = s[15] / n;
  const double xx = s[8] / n - mx * mx, xy = s[9] / n - mx * my, yy = s[11] / n - my * my;
  const double xq = s[13] / n - mx * mq, yq = s[14] / n - my * mq;
  const double det = xx * yy - xy * xy;
  if (!(det > 1e-3 * xx * yy) || !(xx * yy > 0)) return p;
  const double a = (yy * xq - xy * yq) / det, b = (xx * yq - xy * xq) / det;
  const Vec3 plane(a, b, mq - a * mx - b * my);
  const double length = plane.norm();
  if (!(length > 1e-9) || !std::isfinite(length)) return p;
  p.w = plane.cast<float>();
  p.normal = (plane * (-1 / length)).cast<float>();
  return p;
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
  sums_.resize(w * h * kPieceSums);
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
  std::fill_n(sums_.begin(), count() * kPieceSums, 0.0);
  const int w = window_.width;
  for (int v = 0; v < window_.height; ++v) {
    const auto y = static_cast<double>(y_of(v));
    const std::int32_t* label = labels().data() + static_cast<std::ptrdiff_t>(v) * w;
    for (int u = 0; u < w;) {
      const std::int32_t piece = label[u];
      RunSums run;
      for (; u < w && label[u] == piece; ++u) {
        const int i = v * w + u;
        run.pixels += 1;
        if (lab_.coloured(i)) run.add(lab_.at(i));
        const auto z = static_cast<double>(z_[static_cast<std::size_t>(i)]);
        if (z > 0) run.add(static_cast<double>(x_of(u)), z);
      }
      run.put(y, &sums_[static_cast<std::size_t>(piece * kPieceSums)]);
    }
  }
  for (int k = 0; k < count(); ++k)
    pieces_[static_cast<std::size_t>(k)] =
        piece_of(&sums_[static_cast<std::size_t>(k * kPieceSums)], min_readings);
}

}  // namespace perception
