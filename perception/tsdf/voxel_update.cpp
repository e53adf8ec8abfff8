#include "perception/tsdf/voxel_update.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/geometry/no_colour.hpp"
#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/tsdf/voxel_update.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/tsdf/project_block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

// Where colours stand, the same for all of a block.
struct ColourImage {
  VU stride_px, last;  // last: first byte of the image's last pixel
};
HWY_INLINE ColourImage colour_image(const UpdateCamera& c) {
  const DU du;
  return {hn::Set(du, static_cast<std::uint32_t>(c.colour_stride_px)),
          hn::Set(du, 3U * static_cast<std::uint32_t>((c.height - 1) * c.colour_stride_px +
                                                      c.width - 1))};
}

// Blends what the pixels show into the voxels of `near`.
HWY_INLINE void blend(const UpdateCamera& c, const ColourImage& image, MF near,
                      const std::uint32_t* pixel, std::uint32_t* colours) {
  const DU du;
  const DI di;
  // Where each colour stands; all lanes are read, the first pixel for those that are not near. Four bytes in
  // one load, of which the fourth is not looked at: the image's last pixel is read a byte early.
  const VU row = hn::ShiftRight<16>(hn::Load(du, pixel)),
           column = hn::And(hn::Load(du, pixel), hn::Set(du, 0xffffU));
  const VU number = hn::Add(hn::Mul(row, image.stride_px), column);
  const VU triple = hn::Add(number, hn::Add(number, number));
  const auto early = hn::Eq(triple, image.last);
  HWY_ALIGN std::uint32_t seen[16];  // read as far as it is written, by twos
  if (hn::Lanes(du) == 1) seen[1] = 0;
  // A mask's lane is -1.
  const VU close = hn::VecFromMask(du, hn::RebindMask(du, near));
  hn::Store(hn::And(close, hn::Add(triple, hn::VecFromMask(du, early))), du, seen);
  __asm__ volatile("" ::: "memory");
  for (std::size_t n = 0; n < hn::Lanes(du); n += 2) {
    std::uint32_t one = 0, two = 0;
    std::memcpy(&one, c.colour + seen[n], 4);
    std::memcpy(&two, c.colour + seen[n + 1], 4);
    std::uint64_t both = one | static_cast<std::uint64_t>(two) << 32U;
    __asm__ volatile("" : "+r"(both));
    std::memcpy(seen + n, &both, sizeof both);
  }
  const VU four = hn::Load(du, seen), old = hn::LoadU(du, colours);
  const VU now =
      hn::And(hn::IfThenElse(early, hn::ShiftRight<8>(four), four), hn::Set(du, 0xffffffU));
  // What has no colour is 0 and adds nothing: the mean of the n before is what it was.
  const VU n = hn::ShiftRight<28>(old);
  const auto has = hn::VecFromMask(di, hn::Gt(hn::BitCast(di, now), hn::Zero(di)));
  const VU sum = hn::Sub(n, hn::BitCast(du, has));
  const VF fn = to_float(n), count = hn::Max(to_float(sum), set(1.0F));
  const VF inv = hn::Div(set(1.0F), count);
  // Below 2^12 over at most 16. Half a step up, rounded down where count is odd, and between a quarter and three of
  // one, which makes up for the rounding of the reciprocal: count - 1 of them and this are not one more.
  const VF half = mul(add(count, set(0.5F)), set(0.5F));
  const auto mean = [&](VU was, VU is) {
    const VF x = add(add(mul(to_float(was), fn), to_float(is)), half);
    return hn::BitCast(du, truncated(mul(x, inv)));
  };
  const VU byte = hn::Set(du, 0xffU);
  const auto low = [&](VU v) { return hn::And(v, byte); };
  const VU r = mean(low(old), low(now)),
           g = mean(low(hn::ShiftRight<8>(old)), low(hn::ShiftRight<8>(now))),
           b = mean(low(hn::ShiftRight<16>(old)), hn::ShiftRight<16>(now));
  // Counted to 15: of 16 a sixteenth is taken off.
  const VU read = hn::Sub(hn::ShiftRight<28>(hn::ShiftLeft<4>(old)), close);
  const auto capped = [](VU v) { return hn::Sub(v, hn::ShiftRight<4>(v)); };
  const VU counts = hn::Or(hn::ShiftLeft<24>(capped(read)), hn::ShiftLeft<28>(capped(sum)));
  const VU mixed = hn::Or(hn::Or(hn::Or(r, hn::ShiftLeft<8>(g)), hn::ShiftLeft<16>(b)), counts);
  hn::StoreU(hn::IfThenElse(hn::RebindMask(du, near), mixed, old), du, colours);
}

struct Group {
  std::uint64_t set = 0, clear = 0;  // free bits
};

// One vector of voxels, the first of them number n.
HWY_INLINE Group update_group(const UpdateCamera& c, const ColourImage& image,
                              const Projected& seen_at, std::size_t n, std::uint32_t* words,
                              std::uint32_t* colours, BlockCounts& counts) {
  const DF df;
  const DI di;
  const DU du;
  const VF zero = hn::Zero(df), half = set(0.5F);
  const VU reading = hn::Load(du, seen_at.reading + n);
  const VF pz = hn::Load(df, seen_at.z + n);
  const VU depth = hn::And(reading, hn::Set(du, 0xffffU));
  const MF seen = non_zero(depth);
  const VF dz = hn::Sub(mul(to_float(depth), set(0.001F)), pz);
  const VF limit =
      mul(set(c.truncation_m), mul(to_float(hn::ShiftRight<24>(reading)), set(0.03125F)));
  // The stretch is at least 1: what lies beyond the limit without it does so with it.
  const MF maybe = hn::And(seen, hn::And(hn::Le(dz, limit), hn::Ge(dz, hn::Neg(limit))));
  const MF surely_front = hn::And(seen, hn::Gt(dz, limit));
  const VU word = hn::LoadU(du, words + n);
  const VU w = hn::ShiftRight<16>(word);
  if (hn::AllFalse(df, hn::Or(maybe, hn::And(surely_front, non_zero(w)))))
    return {bits_of(surely_front), 0};

  const VF stretch = hn::Sqrt(hn::Load(df, seen_at.stretch2 + n));
  const VF sdf = mul(dz, stretch);
  const VU w_pixel = hn::And(hn::ShiftRight<16>(reading), hn::Set(du, 0xffU));
  const MF front = hn::And(seen, hn::Gt(sdf, limit));
  const MF band = hn::And(hn::And(seen, non_zero(w_pixel)),
                          hn::And(hn::Le(sdf, limit), hn::Ge(sdf, hn::Neg(limit))));
  const MF carve = hn::And(front, non_zero(w));
  const VU w_new =
      hn::IfThenElse(hn::RebindMask(du, band), w_pixel,
                     hn::IfThenElseZero(hn::RebindMask(du, carve), hn::Set(du, kSeenThrough)));
  const VF most = set(32767.0F);
  const VF scaled = mul(sdf, set(c.units_per_m));
  const VF clipped =
      hn::IfThenElse(hn::Gt(scaled, most), most,
                     hn::IfThenElse(hn::Lt(scaled, hn::Neg(most)), hn::Neg(most), scaled));
  const VF value = hn::IfThenElse(band, clipped, most);
  const VU w_sum = hn::Add(w, w_new);
  const VF d = hn::ConvertTo(df, hn::ShiftRight<16>(hn::BitCast(di, hn::ShiftLeft<16>(word))));
  const VF mean = hn::Div(add(mul(d, to_float(w)), mul(value, to_float(w_new))),
                          to_float(hn::Max(w_sum, hn::Set(du, 1U))));
  const VF away = hn::IfThenElse(hn::Ge(mean, zero), half, hn::Neg(half));
  const VU rounded = hn::And(hn::BitCast(du, truncated(add(mean, away))), hn::Set(du, 0xffffU));
  const VU w_kept = hn::Min(w_sum, hn::Set(du, static_cast<std::uint32_t>(c.weight_cap)));
  const VU updated = hn::Or(rounded, hn::ShiftLeft<16>(w_kept));
  const MF learns = hn::Or(band, carve);
  hn::StoreU(hn::IfThenElse(hn::RebindMask(du, learns), updated, word), du, words + n);
  const MF outside = hn::Gt(sdf, zero);
  const VF band_c = set(c.colour_band_m);
  const MF near = hn::And(band, hn::And(hn::Le(sdf, band_c), hn::Ge(sdf, hn::Neg(band_c))));
  if (!hn::AllFalse(df, near)) blend(c, image, near, seen_at.pixel + n, colours + n);
  counts.fused += static_cast<std::int32_t>(hn::CountTrue(df, band));
  counts.carved += static_cast<std::int32_t>(hn::CountTrue(df, carve));
  return {bits_of(hn::Or(front, hn::And(band, outside))), bits_of(hn::AndNot(outside, band))};
}

BlockCounts update_block_words(const UpdateCamera& c, const float (&p0)[3], std::uint32_t* words,
                               std::uint64_t* free, std::uint32_t* colours) {
  BlockCounts counts;
  Projected seen_at;
  if (!project(c, p0, seen_at)) return counts;
  const std::size_t lanes = hn::Lanes(DF());
  const ColourImage image = colour_image(c);
  for (std::size_t x = 0; x < 8; ++x) {
    std::uint64_t set_bits = 0, clear_bits = 0;
    for (std::size_t at = 0; at < 64; at += lanes) {
      const Group g = update_group(c, image, seen_at, x * 64 + at, words, colours, counts);
      set_bits |= g.set << at;
      clear_bits |= g.clear << at;
    }
    free[x] = (free[x] & ~clear_bits) | set_bits;
  }
  return counts;
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {

HWY_EXPORT(update_block_words);

std::uint32_t blend_colour(std::uint32_t old, const std::uint8_t* seen) noexcept {
  const std::uint32_t read = std::min(readings_of(old) + 1, kMostCounted) << 24U;
  if (!has_colour({seen[0], seen[1], seen[2]})) return (old & ~(kMostCounted << 24U)) | read;
  const std::uint32_t n = coloured_readings_of(old), sum = n + 1;
  std::uint32_t out = read | std::min(sum, kMostCounted) << 28U;
  for (unsigned channel = 0; channel < 3; ++channel) {
    const std::uint32_t was = (old >> (8 * channel)) & 0xffU;
    out |= (was * n + seen[channel] + sum / 2) / sum << (8 * channel);
  }
  return out;
}

struct Voxel {
  std::uint32_t& word;
  std::uint32_t& colour;
  std::uint64_t& free;
  std::uint64_t bit;
};

void update_voxel(const UpdateCamera& c, const float (&p)[3], Voxel voxel,
                  BlockCounts& counts) noexcept {
  if (!(p[2] >= kLeastZ)) return;
  const float inv = 1.0F / p[2], x = p[0] * inv, y = p[1] * inv;
  const float u = x * c.fx + c.cx, v = y * c.fy + c.cy;
  if (!(u >= -0.5F && v >= -0.5F && u < static_cast<float>(c.width) - 0.5F &&
        v < static_cast<float>(c.height) - 0.5F))
    return;
  const auto iu = static_cast<int>(u + 0.5F), iv = static_cast<int>(v + 0.5F);
  const std::uint32_t reading = c.pixels[iv * c.width + iu];
  const std::uint32_t depth_mm = reading & 0xffffU, w_pixel = (reading >> 16U) & 0xffU;
  if (depth_mm == 0) return;
  const float limit = c.truncation_m * (static_cast<float>(reading >> 24U) * 0.03125F);
  const float sdf =
      (static_cast<float>(depth_mm) * 0.001F - p[2]) * std::sqrt((1.0F + x * x) + y * y);
  const auto w = static_cast<std::int32_t>(voxel.word >> 16U);
  const auto d = static_cast<std::int32_t>(voxel.word << 16U) >> 16;
  const bool front = sdf > limit;
  const bool band = w_pixel != 0 && sdf <= limit && sdf >= -limit;
  if (front || (band && sdf > 0))
    voxel.free |= voxel.bit;
  else if (band)
    voxel.free &= ~voxel.bit;
  const bool carve = front && w != 0;
  counts.fused += band ? 1 : 0;
  counts.carved += carve ? 1 : 0;
  if (!band && !carve) return;
  const std::int32_t w_new =
      band ? static_cast<std::int32_t>(w_pixel) : static_cast<std::int32_t>(kSeenThrough);
  const float value = band ? std::clamp(sdf * c.units_per_m, -32767.0F, 32767.0F) : 32767.0F;
  const std::int32_t w_sum = w + w_new;
  const float mean =
      (static_cast<float>(d) * static_cast<float>(w) + value * static_cast<float>(w_new)) /
      static_cast<float>(w_sum);
  const auto rounded = static_cast<std::int32_t>(mean + (mean >= 0.0F ? 0.5F : -0.5F));
  voxel.word = (static_cast<std::uint32_t>(rounded) & 0xffffU) |
               static_cast<std::uint32_t>(std::min(w_sum, c.weight_cap)) << 16U;
  if (band && sdf <= c.colour_band_m && sdf >= -c.colour_band_m)
    voxel.colour = blend_colour(voxel.colour, c.colour + 3 * (iv * c.colour_stride_px + iu));
}

}  // namespace

BlockCounts update_block_scalar(const UpdateCamera& c, const float (&p0)[3], std::uint32_t* words,
                                std::uint64_t* free, std::uint32_t* colours) noexcept {
  BlockCounts counts;
  for (std::size_t n = 0; n < 512; ++n) {
    const std::size_t x = n >> 6U, slice = n & 63U;
    float p[3];
    for (int a = 0; a < 3; ++a)
      p[a] = ((p0[a] + static_cast<float>(x) * c.dx[a]) + kSlice.y[slice] * c.dy[a]) +
             kSlice.z[slice] * c.dz[a];
    update_voxel(c, p, {words[n], colours[n], free[x], 1ULL << slice}, counts);
  }
  return counts;
}

BlockCounts update_block(const UpdateCamera& c, const float (&p0)[3], std::uint32_t* words,
                         std::uint64_t* free, std::uint32_t* colours) noexcept {
  // The vectors read a colour in four bytes: an image of one pixel has three.
  if (simd::chosen() == simd::Isa::kScalar || c.width * c.height == 1)
    return update_block_scalar(c, p0, words, free, colours);
  return HWY_DYNAMIC_DISPATCH(update_block_words)(c, p0, words, free, colours);
}

}  // namespace perception
#endif
