#include "perception/segmentation/lab.hpp"

#include <cmath>
#include <cstdint>

namespace perception {
namespace {

// sRGB primaries to XYZ over the white point (IEC 61966-2-1), rows divided by D65.
constexpr double kXyz[3][3] = {{0.4124564 / 0.95047, 0.3575761 / 0.95047, 0.1804375 / 0.95047},
                               {0.2126729, 0.7151522, 0.0721750},
                               {0.0193339 / 1.08883, 0.1191920 / 1.08883, 0.9503041 / 1.08883}};

double linear(double s) noexcept {
  return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
}
double curve(double t) noexcept {
  constexpr double kDelta = 6.0 / 29;
  return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
}

// The curve by linear interpolation; the error stays below 0.05 L (the test measures it).
constexpr int kCurveSteps = 4096;
struct Tables {
  std::array<float, 256> light{};
  std::array<float, kCurveSteps + 2> curve{};
  Tables() {
    for (int i = 0; i < 256; ++i) light[i] = static_cast<float>(linear(i / 255.0));
    for (int i = 0; i < kCurveSteps + 2; ++i) {
      curve[i] = static_cast<float>(perception::curve(double(i) / kCurveSteps));
    }
  }
};
const Tables kTables;

float curve_of(float t) noexcept {
  const float x = t * kCurveSteps;
  const int i = static_cast<int>(x);
  const float f = x - static_cast<float>(i);
  const float c = kTables.curve[static_cast<std::size_t>(i)];
  return c + f * (kTables.curve[static_cast<std::size_t>(i + 1)] - c);
}

struct Out {
  float *L, *a, *b;
};
inline void convert(float r, float g, float b, const Out& out, std::size_t i) noexcept {
  float f[3];
  for (int k = 0; k < 3; ++k) {
    const float t = static_cast<float>(kXyz[k][0]) * r + static_cast<float>(kXyz[k][1]) * g +
                    static_cast<float>(kXyz[k][2]) * b;
    f[k] = curve_of(t < 1 ? t : 1.0F);
  }
  out.L[i] = 116 * f[1] - 16;
  out.a[i] = 500 * (f[0] - f[1]);
  out.b[i] = 200 * (f[1] - f[2]);
}

}  // namespace

Lab lab_of(Rgb c) noexcept {
  const double r = linear(c.r / 255.0), g = linear(c.g / 255.0), b = linear(c.b / 255.0);
  double f[3];
  for (int k = 0; k < 3; ++k) f[k] = curve(kXyz[k][0] * r + kXyz[k][1] * g + kXyz[k][2] * b);
  return {static_cast<float>(116 * f[1] - 16), static_cast<float>(500 * (f[0] - f[1])),
          static_cast<float>(200 * (f[1] - f[2]))};
}

LabImage::LabImage(int max_width, int max_height) {
  for (auto& p : planes_) p.resize(static_cast<std::size_t>(max_width * max_height));
}

void LabImage::set(ImageView<const Rgb> rgb) noexcept {
  width_ = rgb.width;
  height_ = rgb.height;
  const Out out{planes_[0].data(), planes_[1].data(), planes_[2].data()};
  const auto& light = kTables.light;
  for (int v = 0; v < height_; ++v) {
    const Rgb* row = rgb.row(v);
    const auto first = static_cast<std::size_t>(v * width_);
    for (int u = 0; u < width_; ++u) {
      convert(light[row[u].r], light[row[u].g], light[row[u].b], out,
              first + static_cast<std::size_t>(u));
    }
  }
}

void LabImage::set_half(ImageView<const Rgb> rgb) noexcept {
  width_ = rgb.width / 2;
  height_ = rgb.height / 2;
  const Out out{planes_[0].data(), planes_[1].data(), planes_[2].data()};
  const auto& l = kTables.light;
  for (int v = 0; v < height_; ++v) {
    const Rgb *p = rgb.row(2 * v), *q = rgb.row(2 * v + 1);
    const auto first = static_cast<std::size_t>(v * width_);
    for (int u = 0; u < width_; ++u, p += 2, q += 2) {
      convert(0.25F * (l[p[0].r] + l[p[1].r] + l[q[0].r] + l[q[1].r]),
              0.25F * (l[p[0].g] + l[p[1].g] + l[q[0].g] + l[q[1].g]),
              0.25F * (l[p[0].b] + l[p[1].b] + l[q[0].b] + l[q[1].b]), out,
              first + static_cast<std::size_t>(u));
    }
  }
}

}  // namespace perception
