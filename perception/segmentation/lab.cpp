#include "perception/segmentation/lab.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "perception/geometry/no_colour.hpp"
#include "perception/segmentation/lab_kernel.hpp"

namespace perception {
namespace {

double linear(double s) noexcept {
  return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
}
double curve(double t) noexcept {
  constexpr double kDelta = 6.0 / 29;
  return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
}

// The curve by linear interpolation; the error stays below 0.05 L (the test measures it).
struct Tables {
  std::array<float, 256> light{};
  std::array<float, kLabCurveSteps + 2> curve{};
  Tables() {
    for (int i = 0; i < 256; ++i) light[i] = static_cast<float>(linear(i / 255.0));
    for (int i = 0; i < kLabCurveSteps + 2; ++i) {
      curve[i] = static_cast<float>(perception::curve(double(i) / kLabCurveSteps));
    }
  }
};
const Tables kTables;

constexpr int kColoursAtOnce = 64;
struct Light {
  alignas(64) float red[kColoursAtOnce], green[kColoursAtOnce], blue[kColoursAtOnce];
};

// n pixels, in parts: read(i, n, light) fills the linear light of n pixels from pixel i on.
template <class Read>
void convert_row(int n, float* L, float* a, float* b, Read&& read) noexcept {
  Light light;
  for (int i = 0; i < n; i += kColoursAtOnce) {
    const int count = n - i < kColoursAtOnce ? n - i : kColoursAtOnce;
    read(i, count, light);
    convert_light(kTables.curve.data(),
                  {light.red, light.green, light.blue, L + i, a + i, b + i, count});
  }
}

}  // namespace

Lab lab_of(Rgb c) noexcept {
  const double r = linear(c.r / 255.0), g = linear(c.g / 255.0), b = linear(c.b / 255.0);
  double f[3];
  for (int k = 0; k < 3; ++k)
    f[k] = curve(kLabXyz[k][0] * r + kLabXyz[k][1] * g + kLabXyz[k][2] * b);
  return {static_cast<float>(116 * f[1] - 16), static_cast<float>(500 * (f[0] - f[1])),
          static_cast<float>(200 * (f[1] - f[2]))};
}

LabImage::LabImage(int max_width, int max_height) {
  for (auto& p : planes_) p.resize(static_cast<std::size_t>(max_width * max_height));
  known_.resize(static_cast<std::size_t>(max_width * max_height));
}

// The row of known_, for one that may lack colour.
float* LabImage::lacking(int row) noexcept {
  if (complete_) std::fill_n(known_.begin(), width_ * height_, 1.0F);
  complete_ = false;
  return known_.data() + static_cast<std::ptrdiff_t>(row) * width_;
}

void lab_row(const Rgb* pixels, int count, float* L, float* a, float* b) noexcept {
  const auto& light = kTables.light;
  convert_row(count, L, a, b, [&](int first, int n, Light& out) {
    for (int i = 0; i < n; ++i) {
      const Rgb& c = pixels[first + i];
      out.red[i] = light[c.r], out.green[i] = light[c.g], out.blue[i] = light[c.b];
    }
  });
}

void LabImage::set(ImageView<const Rgb> rgb) noexcept {
  width_ = rgb.width;
  height_ = rgb.height;
  complete_ = true;
  for (int v = 0; v < height_; ++v) {
    const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(v) * width_;
    lab_row(rgb.row(v), width_, planes_[0].data() + row, planes_[1].data() + row,
            planes_[2].data() + row);
    if (!may_lack_colour(rgb.row(v), width_)) continue;
    float* known = lacking(v);
    for (int u = 0; u < width_; ++u) known[u] = has_colour(rgb.at(u, v)) ? 1.0F : 0.0F;
  }
}

// No colour is no light: it adds nothing to the sums.
void LabImage::half_row_lacking(const Rgb* above, const Rgb* below, int v) noexcept {
  const auto& l = kTables.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(v) * width_;
  float* known = lacking(v);
  convert_row(width_, planes_[0].data() + row, planes_[1].data() + row, planes_[2].data() + row,
              [&](int first, int n, Light& out) {
                const Rgb *p = above + 2 * first, *q = below + 2 * first;
                for (int i = 0; i < n; ++i, p += 2, q += 2) {
                  const int count =
                      has_colour(p[0]) + has_colour(p[1]) + has_colour(q[0]) + has_colour(q[1]);
                  const float share = 1.0F / static_cast<float>(std::max(count, 1));
                  out.red[i] = share * (l[p[0].r] + l[p[1].r] + l[q[0].r] + l[q[1].r]);
                  out.green[i] = share * (l[p[0].g] + l[p[1].g] + l[q[0].g] + l[q[1].g]);
                  out.blue[i] = share * (l[p[0].b] + l[p[1].b] + l[q[0].b] + l[q[1].b]);
                  known[first + i] = count > 0 ? 1.0F : 0.0F;
                }
              });
}

void LabImage::set_half(ImageView<const Rgb> rgb) noexcept {
  width_ = rgb.width / 2;
  height_ = rgb.height / 2;
  complete_ = true;
  const auto& l = kTables.light;
  for (int v = 0; v < height_; ++v) {
    const Rgb *above = rgb.row(2 * v), *below = rgb.row(2 * v + 1);
    const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(v) * width_;
    if (may_lack_colour(above, 2 * width_) || may_lack_colour(below, 2 * width_)) {
      half_row_lacking(above, below, v);
      continue;
    }
    convert_row(width_, planes_[0].data() + row, planes_[1].data() + row, planes_[2].data() + row,
                [&](int first, int n, Light& out) {
                  const Rgb *p = above + 2 * first, *q = below + 2 * first;
                  for (int i = 0; i < n; ++i, p += 2, q += 2) {
                    out.red[i] = 0.25F * (l[p[0].r] + l[p[1].r] + l[q[0].r] + l[q[1].r]);
                    out.green[i] = 0.25F * (l[p[0].g] + l[p[1].g] + l[q[0].g] + l[q[1].g]);
                    out.blue[i] = 0.25F * (l[p[0].b] + l[p[1].b] + l[q[0].b] + l[q[1].b]);
                  }
                });
  }
}

}  // namespace perception
