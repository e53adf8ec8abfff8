#include "perception/segmentation/reduced_frame.hpp"

#include <algorithm>
#include <array>

#include "perception/geometry/no_colour.hpp"
#include "perception/segmentation/lower_median.hpp"

namespace perception {
namespace {

constexpr int kPixelsAtOnce = 64;  // pixels

// Pixels u to u + n - 1 of row v of the reduced image. Sums down the columns first: they go by
// whole vectors.
template <int kScale>
void mean_row(ImageView<const Rgb> rgb, int u, int v, int n, Rgb* out) noexcept {
  static_assert(sizeof(Rgb) == 3);
  std::array<std::uint16_t, 3 * kScale * kPixelsAtOnce> sum;
  for (int first = 0; first < n; first += kPixelsAtOnce) {
    const int count = std::min(kPixelsAtOnce, n - first), bytes = 3 * kScale * count;
    const auto row = [&](int y) {
      return reinterpret_cast<const std::uint8_t*>(rgb.row(kScale * v + y) + kScale * (u + first));
    };
    const std::uint8_t* p = row(0);
    for (int i = 0; i < bytes; ++i) sum[static_cast<std::size_t>(i)] = p[i];
    for (int y = 1; y < kScale; ++y) {
      p = row(y);
      for (int i = 0; i < bytes; ++i)
        sum[static_cast<std::size_t>(i)] =
            static_cast<std::uint16_t>(sum[static_cast<std::size_t>(i)] + p[i]);
    }
    const std::uint16_t* at = sum.data();
    for (int i = 0; i < count; ++i, at += 3 * kScale) {
      unsigned r = kScale * kScale / 2, g = r, b = r;
      for (int x = 0; x < kScale; ++x) r += at[3 * x], g += at[3 * x + 1], b += at[3 * x + 2];
      const auto mean = [](unsigned s) { return static_cast<std::uint8_t>(s / (kScale * kScale)); };
      out[first + i] = {mean(r), mean(g), mean(b)};
    }
  }
}

// The same where pixels may lack colour.
void mean_row_lacking(ImageView<const Rgb> rgb, int scale, int u, int v, int n, Rgb* out) noexcept {
  for (int i = 0; i < n; ++i) {
    unsigned r = 0, g = 0, b = 0, count = 0;
    for (int y = 0; y < scale; ++y) {
      const Rgb* p = rgb.row(scale * v + y) + static_cast<std::ptrdiff_t>(scale) * (u + i);
      for (int x = 0; x < scale; ++x) {
        r += p[x].r, g += p[x].g, b += p[x].b;
        count += has_colour(p[x]) ? 1U : 0U;
      }
    }
    const auto mean = [&](unsigned s) {
      return static_cast<std::uint8_t>((s + count / 2) / count);
    };
    out[i] = count == 0 ? kNoColour : lifted({mean(r), mean(g), mean(b)});
  }
}

}  // namespace

ReducedFrame::ReducedFrame(int max_width, int max_height)
    : rgb_((max_width + 1) / 2, (max_height + 1) / 2),
      depth_((max_width + 1) / 2, (max_height + 1) / 2) {}

void ReducedFrame::set(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                       const Intrinsics& k, int scale, int u0, int v0, int u1, int v1) noexcept {
  const double s = scale;
  const int w = k.width / scale, h = k.height / scale;
  intrinsics_ = {k.fx / s, k.fy / s, (k.cx + 0.5) / s - 0.5, (k.cy + 0.5) / s - 0.5, w, h};
  rgb_.reshape(w, h);
  depth_.reshape(w, h);
  u0 = std::max(u0, 0), v0 = std::max(v0, 0);
  u1 = std::min(u1, w - 1), v1 = std::min(v1, h - 1);
  const int middle = scale / 2 - 1;
  for (int v = v0; v <= v1; ++v) {
    if (u1 >= u0) {
      bool lacking = false;
      for (int y = 0; y < scale; ++y)
        lacking =
            lacking || may_lack_colour(rgb.row(scale * v + y) + scale * u0, scale * (u1 - u0 + 1));
      if (lacking)
        mean_row_lacking(rgb, scale, u0, v, u1 - u0 + 1, &rgb_.at(u0, v));
      else if (scale == 2)
        mean_row<2>(rgb, u0, v, u1 - u0 + 1, &rgb_.at(u0, v));
      else
        mean_row<4>(rgb, u0, v, u1 - u0 + 1, &rgb_.at(u0, v));
    }
    const std::uint16_t *p = depth.row(scale * v + middle), *q = depth.row(scale * v + middle + 1);
    for (int u = u0; u <= u1; ++u) {
      const int x = scale * u + middle;
      depth_.at(u, v) = lower_median({p[x], p[x + 1], q[x], q[x + 1]});
    }
  }
}

}  // namespace perception
