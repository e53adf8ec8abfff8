#include "drivers/codec/colour_picture.hpp"

#include <algorithm>
#include <array>

#include "perception/geometry/no_colour.hpp"

namespace drivers {

using perception::has_colour;
using perception::ImageView;
using perception::Rgb;
using perception::RgbdFrame;

void fill_colour(ImageView<const Rgb> image, ImageView<Rgb> out) noexcept {
  Rgb last = perception::kNeutral;
  for (int v = 0; v < image.height; ++v) {
    const Rgb* from = image.row(v);
    std::copy_n(from, image.width, out.row(v));
    if (!perception::may_lack_colour(from, image.width)) {
      last = from[image.width - 1];
      continue;
    }
    for (Rgb* to = out.row(v); to < out.row(v) + image.width; ++to) {
      if (!has_colour(*to)) *to = last;
      last = *to;
    }
  }
}

void halve_colour(ImageView<const Rgb> image, ImageView<Rgb> out) noexcept {
  Rgb last = perception::kNeutral;
  for (int v = 0; v < out.height; ++v) {
    const Rgb* const rows[2] = {image.row(2 * v), image.row(std::min(2 * v + 1, image.height - 1))};
    for (int u = 0; u < out.width; ++u) {
      const int columns[2] = {2 * u, std::min(2 * u + 1, image.width - 1)};
      unsigned r = 0, g = 0, b = 0, n = 0;
      for (const Rgb* row : rows) {
        for (const int column : columns) {
          const Rgb c = row[column];
          r += c.r, g += c.g, b += c.b;
          n += has_colour(c) ? 1 : 0;
        }
      }
      if (n > 0)
        last = {static_cast<std::uint8_t>((r + n / 2) / n),
                static_cast<std::uint8_t>((g + n / 2) / n),
                static_cast<std::uint8_t>((b + n / 2) / n)};
      out.row(v)[u] = last;
    }
  }
}

void grow_colour(ImageView<const Rgb> in, ImageView<Rgb> out) noexcept {
  // A pixel is 9/16 of its own cell, 3/16 of the two beside it, 1/16 of the corner.
  struct Sum {
    unsigned r, g, b;
  };
  std::array<Sum, (RgbdFrame::kMaxWidth + 1) / 2> column;
  for (int v = 0; v < out.height; ++v) {
    const int own = v / 2, other = std::clamp(own + (v % 2 == 0 ? -1 : 1), 0, in.height - 1);
    const Rgb *near = in.row(own), *far = in.row(other);
    for (int x = 0; x < in.width; ++x)
      column[static_cast<std::size_t>(x)] = {3U * near[x].r + far[x].r, 3U * near[x].g + far[x].g,
                                             3U * near[x].b + far[x].b};
    for (int u = 0; u < out.width; ++u) {
      const int x = u / 2, beside = std::clamp(x + (u % 2 == 0 ? -1 : 1), 0, in.width - 1);
      const Sum &a = column[static_cast<std::size_t>(x)],
                &c = column[static_cast<std::size_t>(beside)];
      out.row(v)[u] = {static_cast<std::uint8_t>((3 * a.r + c.r + 8) / 16),
                       static_cast<std::uint8_t>((3 * a.g + c.g + 8) / 16),
                       static_cast<std::uint8_t>((3 * a.b + c.b + 8) / 16)};
    }
  }
}

// Coefficients of BT.601 in 1/65536: y = .299 r + .587 g + .114 b, cb and cr halved about 128.
void to_yuv420(ImageView<const Rgb> image, const Yuv420& out) noexcept {
  for (int v = 0; v < out.height; v += 2) {
    const Rgb* const rows[2] = {image.row(v), image.row(std::min(v + 1, image.height - 1))};
    for (int k = 0; k < 2; ++k) {
      std::uint8_t* y = out.y + static_cast<std::ptrdiff_t>(v + k) * out.y_stride;
      for (int u = 0; u < image.width; ++u) {
        const Rgb c = rows[k][u];
        y[u] = static_cast<std::uint8_t>((19595 * c.r + 38470 * c.g + 7471 * c.b + 32768) >> 16);
      }
      if (out.width > image.width) y[image.width] = y[image.width - 1];
    }
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v / 2) * out.c_stride;
    for (int u = 0; u < out.width; u += 2) {
      const int next = std::min(u + 1, image.width - 1);
      const Rgb p[4] = {rows[0][u], rows[0][next], rows[1][u], rows[1][next]};
      const int r = p[0].r + p[1].r + p[2].r + p[3].r, g = p[0].g + p[1].g + p[2].g + p[3].g,
                b = p[0].b + p[1].b + p[2].b + p[3].b;
      // Sums of four: 128 and the rounding are in 1/262144 too.
      constexpr int kMiddle = (128 << 18) + (1 << 17) - 1;
      out.cb[at + u / 2] =
          static_cast<std::uint8_t>((-11059 * r - 21709 * g + 32768 * b + kMiddle) >> 18);
      out.cr[at + u / 2] =
          static_cast<std::uint8_t>((32768 * r - 27439 * g - 5329 * b + kMiddle) >> 18);
    }
  }
}

void from_yuv420(const Yuv420& in, ImageView<Rgb> image) noexcept {
  const auto byte = [](int v) { return static_cast<std::uint8_t>(std::clamp(v >> 16, 0, 255)); };
  for (int v = 0; v < image.height; ++v) {
    const std::uint8_t* y = in.y + static_cast<std::ptrdiff_t>(v) * in.y_stride;
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v / 2) * in.c_stride;
    Rgb* to = image.row(v);
    for (int u = 0; u < image.width; ++u) {
      const int luma = (y[u] << 16) + 32768, cb = in.cb[at + u / 2] - 128,
                cr = in.cr[at + u / 2] - 128;
      to[u] = {byte(luma + 91881 * cr), byte(luma - 22554 * cb - 46802 * cr),
               byte(luma + 116130 * cb)};
    }
  }
}

}  // namespace drivers
