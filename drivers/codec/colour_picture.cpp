#include "drivers/codec/colour_picture.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "drivers/codec/clones.hpp"
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

namespace {

constexpr std::size_t kMostBytes = 3 * static_cast<std::size_t>(RgbdFrame::kMaxWidth);

const std::uint8_t* bytes(const Rgb* pixels) noexcept {
  return reinterpret_cast<const std::uint8_t*>(pixels);
}

TELETACT_CODEC_CLONES void add_rows(const std::uint8_t* a, const std::uint8_t* b, int n,
                                    std::uint16_t* sum) noexcept {
#pragma GCC ivdep
  for (int i = 0; i < n; ++i) sum[i] = static_cast<std::uint16_t>(a[i] + b[i]);
}

// Two rows of which every pixel has colour.
void halve_rows(const Rgb* above, const Rgb* below, int width, Rgb* out, int count) noexcept {
  // One pixel more, for an odd width, and four lanes are read where three count.
  std::array<std::uint16_t, kMostBytes + 4> sum;
  const auto n = static_cast<std::size_t>(3 * width);
  add_rows(bytes(above), bytes(below), static_cast<int>(n), sum.data());
  std::copy_n(sum.data() + n - 3, 3, sum.data() + n);
  sum[n + 3] = 0;
  for (int u = 0; u < count; ++u) {
    // Lanes of 16 bits: four of 255 do not carry.
    std::uint64_t left = 0, right = 0;
    std::memcpy(&left, sum.data() + 6 * u, 8);
    std::memcpy(&right, sum.data() + 6 * u + 3, 8);
    const std::uint64_t mean = (left + right + 0x0002000200020002U) >> 2U;
    out[u] = {static_cast<std::uint8_t>(mean), static_cast<std::uint8_t>(mean >> 16U),
              static_cast<std::uint8_t>(mean >> 32U)};
  }
}

Rgb mean_of_coloured(const Rgb (&cell)[4], Rgb otherwise) noexcept {
  unsigned r = 0, g = 0, b = 0, n = 0;
  for (const Rgb c : cell) {
    r += c.r, g += c.g, b += c.b;
    n += has_colour(c) ? 1 : 0;
  }
  if (n == 0) return otherwise;
  return {static_cast<std::uint8_t>((r + n / 2) / n), static_cast<std::uint8_t>((g + n / 2) / n),
          static_cast<std::uint8_t>((b + n / 2) / n)};
}

}  // namespace

void halve_colour(ImageView<const Rgb> image, ImageView<Rgb> out) noexcept {
  Rgb last = perception::kNeutral;
  for (int v = 0; v < out.height; ++v) {
    const Rgb *above = image.row(2 * v), *below = image.row(std::min(2 * v + 1, image.height - 1));
    Rgb* to = out.row(v);
    if (!perception::may_lack_colour(above, image.width) &&
        !perception::may_lack_colour(below, image.width)) {
      halve_rows(above, below, image.width, to, out.width);
      last = to[out.width - 1];
      continue;
    }
    for (int u = 0; u < out.width; ++u) {
      const int x = 2 * u, beside = std::min(2 * u + 1, image.width - 1);
      to[u] = last = mean_of_coloured({above[x], above[beside], below[x], below[beside]}, last);
    }
  }
}

namespace {

TELETACT_CODEC_CLONES void mix_rows(const std::uint8_t* near, const std::uint8_t* far, int n,
                                    std::uint16_t* sum) noexcept {
#pragma GCC ivdep
  for (int i = 0; i < n; ++i) sum[i] = static_cast<std::uint16_t>(3 * near[i] + far[i]);
}

TELETACT_CODEC_CLONES void mix_cells(const std::uint16_t* own, const std::uint16_t* beside, int n,
                                     std::uint8_t* out) noexcept {
#pragma GCC ivdep
  for (int i = 0; i < n; ++i)
    out[i] = static_cast<std::uint8_t>(static_cast<std::uint16_t>(3 * own[i] + beside[i] + 8) >> 4);
}

// One pixel of each in turn, `width` of both together. A pair is written as eight bytes, of which
// the next pair overwrites two; so the last ones are written one by one.
void weave(const std::uint8_t* left, const std::uint8_t* right, int width, Rgb* out) noexcept {
  static_assert(std::endian::native == std::endian::little);
  constexpr std::uint64_t kPixel = 0xffffff;
  auto* to = reinterpret_cast<std::uint8_t*>(out);
  int u = 0;
  for (; u + 2 < width; u += 2) {
    std::uint32_t a = 0, b = 0;
    std::memcpy(&a, left + 3 * (u / 2), 4);
    std::memcpy(&b, right + 3 * (u / 2), 4);
    const std::uint64_t pair = (a & kPixel) | (b & kPixel) << 24U;
    std::memcpy(to + 3 * u, &pair, 8);
  }
  for (; u < width; ++u) std::memcpy(to + 3 * u, (u % 2 == 0 ? left : right) + 3 * (u / 2), 3);
}

}  // namespace

void grow_colour(ImageView<const Rgb> in, ImageView<Rgb> out) noexcept {
  // A pixel is 9/16 of its own cell, 3/16 of the two beside it, 1/16 of the corner. A cell's left
  // pixels and its right ones are computed apart; the border's cells stand beside themselves.
  std::array<std::uint16_t, kMostBytes / 2 + 12> column;
  std::array<std::uint8_t, kMostBytes / 2 + 6> left, right;
  const int n = 3 * in.width;
  std::uint16_t* own = column.data() + 3;
  for (int v = 0; v < out.height; ++v) {
    const int cell = v / 2, other = std::clamp(cell + (v % 2 == 0 ? -1 : 1), 0, in.height - 1);
    mix_rows(bytes(in.row(cell)), bytes(in.row(other)), n, own);
    std::copy_n(own, 3, column.data());
    std::copy_n(own + n - 3, 3, own + n);
    mix_cells(own, own - 3, n, left.data());
    mix_cells(own, own + 3, n, right.data());
    weave(left.data(), right.data(), out.width, out.row(v));
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

namespace {

// Of a row: in RGB, each channel by itself. Chroma has an entry for each pixel.
struct RowPlanes {
  std::array<std::uint8_t, RgbdFrame::kMaxWidth + 1> cb, cr, r, g, b;
};

TELETACT_CODEC_CLONES void to_rgb(const std::uint8_t* y, int n, RowPlanes& row) noexcept {
#pragma GCC ivdep
  for (int u = 0; u < n; ++u) {
    const auto i = static_cast<std::size_t>(u);
    const int luma = (y[u] << 16) + 32768, cb = row.cb[i] - 128, cr = row.cr[i] - 128;
    const int r = (luma + 91881 * cr) >> 16, g = (luma - 22554 * cb - 46802 * cr) >> 16,
              b = (luma + 116130 * cb) >> 16;
    row.r[i] = static_cast<std::uint8_t>(std::min(std::max(r, 0), 255));
    row.g[i] = static_cast<std::uint8_t>(std::min(std::max(g, 0), 255));
    row.b[i] = static_cast<std::uint8_t>(std::min(std::max(b, 0), 255));
  }
}

}  // namespace

void from_yuv420(const Yuv420& in, ImageView<Rgb> image) noexcept {
  RowPlanes row;
  for (int v = 0; v < image.height; ++v) {
    if (v % 2 == 0) {  // a row of chroma is of two
      const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v / 2) * in.c_stride;
      for (int u = 0; u < image.width; ++u) {
        row.cb[static_cast<std::size_t>(u)] = in.cb[at + u / 2];
        row.cr[static_cast<std::size_t>(u)] = in.cr[at + u / 2];
      }
    }
    to_rgb(in.y + static_cast<std::ptrdiff_t>(v) * in.y_stride, image.width, row);
    Rgb* to = image.row(v);
    for (std::size_t u = 0; u < static_cast<std::size_t>(image.width); ++u)
      to[u] = {row.r[u], row.g[u], row.b[u]};
  }
}

}  // namespace drivers
