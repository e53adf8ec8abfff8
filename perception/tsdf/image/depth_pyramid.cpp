#include "perception/tsdf/image/depth_pyramid.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

#include "perception/simd/clones.hpp"

namespace perception {
namespace {

constexpr int kPad = 2;

TELETACT_CLONES
void sanitise_row(const std::uint16_t* in, int width, std::uint16_t min_mm,
                  std::uint16_t* out) noexcept {
  for (int u = 0; u < width; ++u) {
    const std::uint16_t d = in[u];
    out[u] = (d >= min_mm && d != 65535) ? d : std::uint16_t{0};
  }
}

struct RowRule {
  std::int32_t edge_base_mm, edge_per_q16, max_mm;
};

// Input: five padded rows, [2] is the pixel's own. Output: one row of pixels without reach. All in
// int32 and without a branch, so that the compiler vectorises it.
TELETACT_CLONES
void classify_row(const std::uint16_t* const (&rows)[5], int width, RowRule rule,
                  std::uint32_t* out) noexcept {
  const std::uint16_t *above = rows[1] + kPad - 1, *here = rows[2] + kPad - 1,
                      *below = rows[3] + kPad - 1;
  const RowRule r = rule;
  for (int u = 0; u < width; ++u) {
    const std::int32_t n[9] = {above[u],    above[u + 1], above[u + 2], here[u],     here[u + 1],
                               here[u + 2], below[u],     below[u + 1], below[u + 2]};
    const std::int32_t c = n[4];
    const std::int32_t gate = r.edge_base_mm + ((r.edge_per_q16 * (c >> 1)) >> 15);
    const auto differs = [c, gate](std::int32_t d) {
      const std::int32_t far = d > c ? d - c : c - d;
      return static_cast<std::int32_t>(d != 0) & static_cast<std::int32_t>(far > gate);
    };
    const std::int32_t edge = differs(n[1]) | differs(n[7]) | differs(n[3]) | differs(n[5]);
    // Least of the valid readings: 0 wraps to the top.
    std::int32_t least = 0xffff, readings = 0;
    for (const std::int32_t d : n) {
      const std::int32_t from_one = (d - 1) & 0xffff;
      least = from_one < least ? from_one : least;
      readings += static_cast<std::int32_t>(d != 0);
    }
    const std::int32_t missing = static_cast<std::int32_t>(c == 0);
    const std::int32_t hole =
        missing & static_cast<std::int32_t>(readings < DepthPyramid::kFillFrom);
    const std::int32_t depth = (edge | missing) != 0 ? least + 1 : c;
    const std::int32_t fused =
        (missing ^ 1) & (edge ^ 1) & static_cast<std::int32_t>(c <= r.max_mm);
    out[u] = static_cast<std::uint32_t>(hole != 0 ? 0 : (depth | (fused << 23)));
  }
}
static_assert(DepthPyramid::kWeightOne << 16 == 1 << 23);

// Slope of depth, mm a pixel, over two pixels either side; a side without a reading, or across an
// edge, counts as the centre itself (the slope is then too small: the band stays short).
inline float slope(std::int32_t low, std::int32_t mid, std::int32_t high,
                   std::int32_t gate) noexcept {
  const bool has_low = (low != 0) & (std::abs(low - mid) <= 2 * gate);
  const bool has_high = (high != 0) & (std::abs(high - mid) <= 2 * gate);
  const std::int32_t rise = (has_high ? high : mid) - (has_low ? low : mid);
  return static_cast<float>(rise) * ((has_high & has_low) ? 0.25F : 0.5F);
}

TELETACT_CLONES
void reach_row(const std::uint16_t* const (&rows)[5], int width, float y, const DepthRule& rule,
               RowRule row, std::uint32_t* out) noexcept {
  const std::uint16_t *above = rows[0] + kPad, *here = rows[2], *below = rows[4] + kPad;
  const float fx = rule.fx, fy = rule.fy, cx = rule.cx, inv_fx = 1.0F / rule.fx;
  for (int u = 0; u < width; ++u) {
    const std::int32_t c = here[u + kPad];
    const std::int32_t gate = row.edge_base_mm + ((row.edge_per_q16 * (c >> 1)) >> 15);
    const float z = static_cast<float>(c > 1 ? c : 1);
    const float zu = slope(here[u], c, here[u + 2 * kPad], gate);
    const float zv = slope(above[u], c, below[u], gate);
    // Normal n = (-fx zu, -fy zv, z + (u-cx) zu + (v-cy) zv), ray r = (x, y, 1): n.r = z.
    const float du = static_cast<float>(u) - cx, x = du * inv_fx;
    const float nx = fx * zu, ny = fy * zv, nz = (z + du * zu) + (y * fy) * zv;
    const float nn = (nx * nx + ny * ny) + nz * nz, rr = (x * x + y * y) + 1.0F;
    const float inverse_cos = std::sqrt(nn * rr) / z;
    const float raw =
        std::min(std::max(inverse_cos * rule.reach_gain * 32.0F, 32.0F), 96.0F) + 0.5F;
    const std::uint32_t p = out[u];
    const std::uint32_t reach =
        (p >> 16U) != 0 ? static_cast<std::uint32_t>(static_cast<std::int32_t>(raw)) : 32U;
    out[u] = p != 0 ? (p | (reach << 24U)) : 0U;
  }
}

TELETACT_CLONES
void weigh_row(std::uint32_t* row, int width) noexcept {
  for (int u = 0; u < width; ++u) {
    const float q = 1500.0F / static_cast<float>(std::max(row[u] & 0xffffU, 1U));
    const float w = std::min(std::max(q * q * 128.0F, 32.0F), 128.0F);
    const auto raw = static_cast<std::uint32_t>(static_cast<std::int32_t>(w + 0.5F));
    row[u] = (row[u] >> 16U) != 0 ? ((row[u] & 0xffffU) | (raw << 16U)) : row[u];
  }
}

// A pixel that is masked keeps its depth and loses its weight.
TELETACT_CLONES
void carve_only_row(const std::uint8_t* mask, int width, std::uint32_t* row) noexcept {
  constexpr std::uint32_t kReach = static_cast<std::uint32_t>(DepthPyramid::kReachOne) << 24U;
  for (int u = 0; u < width; ++u) {
    const std::uint32_t p = row[u], depth = p & 0xffffU;
    row[u] = mask[u] != 0 && depth != 0 ? depth | kReach : p;
  }
}

TELETACT_CLONES
int count_fused(const std::uint32_t* p, int n) noexcept {
  int count = 0;
  for (int i = 0; i < n; ++i) count += static_cast<int>(((p[i] >> 16U) & 0xffU) != 0);
  return count;
}

using Range = DepthPyramid::Range;

// A tile holds its least reading, and 65535 minus its greatest, so that both combine by a minimum.
using Tile = DepthPyramid::Tile;

Tile merged(Tile a, Tile b) noexcept {
  return {std::min(a.least_mm, b.least_mm), std::min(a.below_top_mm, b.below_top_mm)};
}
Tile single(std::uint32_t pixel) noexcept {
  const auto d = static_cast<std::uint16_t>(pixel & 0xffffU);
  return {d, static_cast<std::uint16_t>(65535U - d)};
}

TELETACT_CLONES
void halve_pixels(const std::uint32_t* a, const std::uint32_t* b, int pairs, Tile* out) noexcept {
  for (int u = 0; u < pairs; ++u) {
    const auto p = static_cast<std::uint16_t>(a[2 * u]),
               q = static_cast<std::uint16_t>(a[2 * u + 1]);
    const auto r = static_cast<std::uint16_t>(b[2 * u]),
               s = static_cast<std::uint16_t>(b[2 * u + 1]);
    const auto most = std::max(std::max(p, q), std::max(r, s));
    out[u] = {std::min(std::min(p, q), std::min(r, s)), static_cast<std::uint16_t>(65535 - most)};
  }
}

// Finest level at which no side of the rectangle meets more than three tiles: a side of fewer than
// 3 * 2^l pixels meets at most four at l, and three at l + 1.
int level_of(int u0, int v0, int u1, int v1) noexcept {
  const auto span = static_cast<std::uint32_t>(std::max(u1 - u0, v1 - v0));
  if (span <= 2) return 0;
  const int bits = std::bit_width(span);
  int l = span < 3U << (bits - 2) ? bits - 2 : bits - 1;
  if ((u1 >> l) - (u0 >> l) > 2 || (v1 >> l) - (v0 >> l) > 2) ++l;
  return std::min(l, DepthPyramid::kLevels - 1);
}

using Short8 = std::uint16_t __attribute__((vector_size(16)));

// Of up to four tiles in a row; four may be read.
Short8 row_of(const Tile* tiles, int count) noexcept {
  static constexpr std::uint16_t kNot = 0xffff;
  alignas(16) static constexpr std::uint16_t kBeyond[4][8] = {
      {0, 0, kNot, kNot, kNot, kNot, kNot, kNot},
      {0, 0, 0, 0, kNot, kNot, kNot, kNot},
      {0, 0, 0, 0, 0, 0, kNot, kNot},
      {0, 0, 0, 0, 0, 0, 0, 0}};
  Short8 v, beyond;
  std::memcpy(&v, tiles, sizeof v);
  std::memcpy(&beyond, kBeyond[count - 1], sizeof beyond);
  return v | beyond;
}

Short8 least_of(Short8 a, Short8 b) noexcept { return a < b ? a : b; }

}  // namespace

DepthPyramid::DepthPyramid(rt::NonRealtime&)
    : padded_(static_cast<std::size_t>(kMaxWidth + 2 * kPad) * (kMaxHeight + 2 * kPad)),
      pixels_(static_cast<std::size_t>(kMaxWidth) * kMaxHeight + 32) {
  for (int l = 1; l < kLevels; ++l) {
    const auto w = static_cast<std::size_t>(((kMaxWidth - 1) >> l) + 1);
    const auto h = static_cast<std::size_t>(((kMaxHeight - 1) >> l) + 1);
    levels_[static_cast<std::size_t>(l)].tiles.resize(w * h + 3);  // four are read at once
  }
}

const std::uint16_t* DepthPyramid::padded_row(int v) const noexcept {
  return padded_.data() + static_cast<std::ptrdiff_t>(width_ + 2 * kPad) * (v + kPad);
}

int DepthPyramid::build(ImageView<const std::uint16_t> depth_mm, const DepthRule& rule,
                        rt::ForkJoin& crew, ImageView<const std::uint8_t> mask) noexcept {
  width_ = depth_mm.width, height_ = depth_mm.height;
  const int pitch = width_ + 2 * kPad;
  const auto min_mm = static_cast<std::uint16_t>(
      std::clamp(static_cast<int>(rule.min_depth_m * 1000.0F + 0.5F), 1, 65534));
  for (int v = -kPad; v < height_ + kPad; ++v) {
    std::uint16_t* row = padded_.data() + static_cast<std::ptrdiff_t>(pitch) * (v + kPad);
    std::fill_n(row, pitch, std::uint16_t{0});
    if (v >= 0 && v < height_) sanitise_row(depth_mm.row(v), width_, min_mm, row + kPad);
  }
  pixels_[static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_)] = 0;
  int w = width_, h = height_;
  for (int l = 1; l < kLevels; ++l) {
    Level& level = levels_[static_cast<std::size_t>(l)];
    level.width = w = (w + 1) / 2;
    level.height = h = (h + 1) / 2;
  }
  constexpr int kStrip = 1 << (kLevels - 1);
  constexpr int kMostStrips = (kMaxHeight + kStrip - 1) / kStrip;
  std::array<int, kMostStrips> fused{};
  crew.for_parts((height_ + kStrip - 1) / kStrip, [&](int p) {
    fused[static_cast<std::size_t>(p)] =
        build_strip(rule, mask, p * kStrip, std::min((p + 1) * kStrip, height_));
  });
  return std::accumulate(fused.begin(), fused.end(), 0);
}

int DepthPyramid::build_strip(const DepthRule& rule, ImageView<const std::uint8_t> mask, int v0,
                              int v1) noexcept {
  const RowRule r{static_cast<std::int32_t>(rule.edge_base_m * 1000.0F + 0.5F),
                  static_cast<std::int32_t>(rule.edge_per_m * 65536.0F + 0.5F),
                  static_cast<std::int32_t>(rule.max_depth_m * 1000.0F + 0.5F)};
  for (int v = v0; v < v1; ++v) {
    const std::uint16_t* const rows[5] = {padded_row(v - 2), padded_row(v - 1), padded_row(v),
                                          padded_row(v + 1), padded_row(v + 2)};
    std::uint32_t* out = pixels_.data() + static_cast<std::ptrdiff_t>(width_) * v;
    classify_row(rows, width_, r, out);
    if (rule.range_weight) weigh_row(out, width_);
    reach_row(rows, width_, (static_cast<float>(v) - rule.cy) / rule.fy, rule, r, out);
    if (mask.data != nullptr) carve_only_row(mask.row(v), width_, out);
  }
  for (int l = 1; l < kLevels; ++l) build_tiles(l, v0 >> l, (v1 + (1 << l) - 1) >> l);
  return count_fused(pixels_.data() + static_cast<std::ptrdiff_t>(width_) * v0, width_ * (v1 - v0));
}

void DepthPyramid::build_tiles(int l, int v0, int v1) noexcept {
  Level& to = levels_[static_cast<std::size_t>(l)];
  const Level& from = levels_[static_cast<std::size_t>(l - 1)];
  const int fw = l == 1 ? width_ : from.width, fh = l == 1 ? height_ : from.height;
  for (int v = v0; v < v1; ++v) {
    const int va = 2 * v, vb = std::min(2 * v + 1, fh - 1);
    Tile* out = to.tiles.data() + static_cast<std::ptrdiff_t>(v) * to.width;
    if (l == 1) {
      const std::uint32_t* a = pixels_.data() + static_cast<std::ptrdiff_t>(va) * fw;
      const std::uint32_t* b = pixels_.data() + static_cast<std::ptrdiff_t>(vb) * fw;
      halve_pixels(a, b, fw / 2, out);
      if (fw % 2 != 0) out[to.width - 1] = merged(single(a[fw - 1]), single(b[fw - 1]));
    } else {
      const Tile* a = from.tiles.data() + static_cast<std::ptrdiff_t>(va) * fw;
      const Tile* b = from.tiles.data() + static_cast<std::ptrdiff_t>(vb) * fw;
      for (int u = 0; u < to.width; ++u) {
        const int ua = 2 * u, ub = std::min(2 * u + 1, fw - 1);
        out[u] = merged(merged(a[ua], a[ub]), merged(b[ua], b[ub]));
      }
    }
  }
}

std::size_t DepthPyramid::memory_bytes() const noexcept {
  std::size_t n = padded_.capacity() * sizeof padded_[0] + pixels_.capacity() * sizeof pixels_[0];
  for (const Level& l : levels_) n += l.tiles.capacity() * sizeof(Tile);
  return n;
}

DepthPyramid::Range DepthPyramid::range(int u0, int v0, int u1, int v1) const noexcept {
  const int l = level_of(u0, v0, u1, v1);
  Tile all{65535, 65535};
  if (l == 0) {
    for (int v = v0; v <= v1; ++v)
      for (int u = u0; u <= u1; ++u)
        all = merged(all, single(pixels_[static_cast<std::size_t>(v * width_ + u)]));
    return {all.least_mm, static_cast<std::uint16_t>(65535 - all.below_top_mm)};
  }
  const Level& level = levels_[static_cast<std::size_t>(l)];
  const int first = u0 >> l, last = u1 >> l;
  Short8 least = ~Short8{};
  for (int v = v0 >> l; v <= v1 >> l; ++v) {
    const Tile* row = level.tiles.data() + static_cast<std::ptrdiff_t>(v) * level.width;
    for (int u = first; u <= last; u += 4)
      least = least_of(least, row_of(row + u, std::min(last - u + 1, 4)));
  }
  Tile four[4];
  static_assert(sizeof four == sizeof least);
  std::memcpy(four, &least, sizeof four);
  all = merged(merged(four[0], four[1]), merged(four[2], four[3]));
  return {all.least_mm, static_cast<std::uint16_t>(65535 - all.below_top_mm)};
}

}  // namespace perception
