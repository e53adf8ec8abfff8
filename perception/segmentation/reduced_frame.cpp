#include "perception/segmentation/reduced_frame.hpp"

#include <algorithm>
#include <array>

#include "perception/segmentation/lower_median.hpp"

namespace perception {
namespace {

Rgb mean_of(ImageView<const Rgb> rgb, int u, int v, int scale) noexcept {
  int r = 0, g = 0, b = 0;
  for (int y = v; y < v + scale; ++y) {
    const Rgb* row = rgb.row(y);
    for (int x = u; x < u + scale; ++x) r += row[x].r, g += row[x].g, b += row[x].b;
  }
  const int n = scale * scale;
  return {static_cast<std::uint8_t>((r + n / 2) / n), static_cast<std::uint8_t>((g + n / 2) / n),
          static_cast<std::uint8_t>((b + n / 2) / n)};
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
    const std::uint16_t *p = depth.row(scale * v + middle), *q = depth.row(scale * v + middle + 1);
    for (int u = u0; u <= u1; ++u) {
      const int x = scale * u + middle;
      rgb_.at(u, v) = mean_of(rgb, scale * u, scale * v, scale);
      depth_.at(u, v) = lower_median({p[x], p[x + 1], q[x], q[x + 1]});
    }
  }
}

}  // namespace perception
