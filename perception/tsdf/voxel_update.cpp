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

// What is known of a block's nodes, and which of them are still to be worked on. A branch that depends on a
// reading is hard to guess; so every step but the last leaves a list, and the next one goes through that.
struct Work {
  Projected at;
  std::uint32_t first[512];            // of a vector of nodes
  std::uint32_t lanes[512];            // of it
  HWY_ALIGN std::uint32_t byte[512];   // of the image, for the vectors listed
  HWY_ALIGN std::uint32_t shown[512];  // there
  std::uint64_t set[8], clear[8];      // free bits
};

// Whether bit n of a block's free bits is to be set or cleared.
HWY_INLINE void put_bits(std::uint64_t (&words)[8], std::size_t n, unsigned bits) {
  words[n >> 6U] |= static_cast<std::uint64_t>(bits) << (n & 63U);
}

// The inverse of mask_bits().
HWY_INLINE hn::Mask<DU> lanes_of(unsigned bits) {
#if HWY_TARGET == HWY_AVX3
  return hn::Mask<DU>{static_cast<__mmask16>(bits)};
#else
  const VU lane = hn::Shl(hn::Set(DU(), 1U), hn::Iota(DU(), 0U));
  return hn::TestBit(hn::Set(DU(), bits), lane);
#endif
}

HWY_INLINE VF limit_of(const UpdateCamera& c, VU reading) {
  return mul(set(c.truncation_m * 0.03125F), to_float(hn::ShiftRight<24>(reading)));
}
HWY_INLINE VU depth_of(VU reading) { return hn::And(reading, hn::Set(DU(), 0xffffU)); }

// Lists the vectors in which something is learned, or may be; turns z into how far the reading lies behind.
HWY_INLINE std::size_t list_learners(const UpdateCamera& c, const std::uint32_t* words,
                                     const std::uint32_t* colours, Work& work) {
  const DF df;
  const DU du;
  std::uint32_t band[512];
  std::size_t reached = 0;
  for (std::size_t x = 0; x < 8; ++x) work.set[x] = work.clear[x] = 0;
  const VF band_c = set(c.colour_band_m);
  for (std::size_t n = 0; n < 512; n += hn::Lanes(df)) {
    const VU reading = hn::Load(du, work.at.reading + n), depth = depth_of(reading);
    const MF seen = non_zero(depth);
    const VF dz = hn::Sub(mul(to_float(depth), set(0.001F)), hn::Load(df, work.at.z + n));
    hn::Store(dz, df, work.at.z + n);
    const VF limit = limit_of(c, reading);
    // The stretch is at least 1: what lies beyond the limit without it does so with it.
    const VF away = hn::Abs(dz);
    const MF in_band = hn::And(seen, hn::Le(away, limit));
    const unsigned maybe = mask_bits(in_band), front = mask_bits(hn::And(seen, hn::Gt(dz, limit)));
    put_bits(work.set, n, front);
    // Its memory is asked for, if it may take colour.
    const unsigned near = mask_bits(hn::And(in_band, hn::Le(away, band_c)));
    __builtin_prefetch(colours + (near != 0 ? n : 0), 1);
    work.first[reached] = static_cast<std::uint32_t>(n);
    work.lanes[reached] = front;
    band[reached] = maybe;
    reached += (maybe | front) != 0 ? 1 : 0;
  }
  std::size_t count = 0;
  for (std::size_t i = 0; i < reached; ++i) {
    const std::uint32_t n = work.first[i];
    const unsigned known = mask_bits(non_zero(hn::ShiftRight<16>(hn::LoadU(du, words + n))));
    const unsigned learns = band[i] | (work.lanes[i] & known);
    work.first[count] = n;
    count += learns != 0 ? 1 : 0;
  }
  return count;
}

// Distances and weights of the first `count` vectors listed; lists those near the surface instead.
HWY_INLINE std::size_t update_words(const UpdateCamera& c, std::size_t count, std::uint32_t* words,
                                    Work& work, BlockCounts& counts) {
  const DF df;
  const DI di;
  const DU du;
  const VF zero = hn::Zero(df), half = set(0.5F), most = set(32767.0F);
  const VF units_per_m = set(c.units_per_m), band_c = set(c.colour_band_m);
  const VU weight_cap = hn::Set(du, static_cast<std::uint32_t>(c.weight_cap));
  std::size_t near_count = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t n = work.first[i];
    const VU reading = hn::Load(du, work.at.reading + n);
    const VU word = hn::LoadU(du, words + n);
    const VU w = hn::ShiftRight<16>(word);
    const MF seen = non_zero(depth_of(reading));
    const VF limit = limit_of(c, reading);
    const VF sdf = mul(hn::Load(df, work.at.z + n), hn::Sqrt(hn::Load(df, work.at.stretch2 + n)));
    const VF away = hn::Abs(sdf);
    const VU w_pixel = hn::And(hn::ShiftRight<16>(reading), hn::Set(du, 0xffU));
    const MF front = hn::And(seen, hn::Gt(sdf, limit));
    const MF band = hn::And(hn::And(seen, non_zero(w_pixel)), hn::Le(away, limit));
    const MF carve = hn::And(front, non_zero(w));
    const VU w_new =
        hn::IfThenElse(hn::RebindMask(du, band), w_pixel,
                       hn::IfThenElseZero(hn::RebindMask(du, carve), hn::Set(du, kSeenThrough)));
    const VF clipped = hn::Max(hn::Min(mul(sdf, units_per_m), most), hn::Neg(most));
    const VF value = hn::IfThenElse(band, clipped, most);
    const VU w_sum = hn::Add(w, w_new);
    const VF d = hn::ConvertTo(df, hn::ShiftRight<16>(hn::BitCast(di, hn::ShiftLeft<16>(word))));
    const VF mean = hn::Div(add(mul(d, to_float(w)), mul(value, to_float(w_new))),
                            to_float(hn::Max(w_sum, hn::Set(du, 1U))));
    const VF up = hn::IfThenElse(hn::Ge(mean, zero), half, hn::Neg(half));
    const VU rounded = hn::And(hn::BitCast(du, truncated(add(mean, up))), hn::Set(du, 0xffffU));
    const VU updated = hn::Or(rounded, hn::ShiftLeft<16>(hn::Min(w_sum, weight_cap)));
    const MF learns = hn::Or(band, carve);
    hn::StoreU(hn::IfThenElse(hn::RebindMask(du, learns), updated, word), du, words + n);
    const MF outside = hn::Gt(sdf, zero);
    const unsigned near = mask_bits(hn::And(band, hn::Le(away, band_c)));
    put_bits(work.set, n, mask_bits(hn::Or(front, hn::And(band, outside))));
    put_bits(work.clear, n, mask_bits(hn::AndNot(outside, band)));
    counts.fused += static_cast<std::int32_t>(hn::CountTrue(df, band));
    counts.carved += static_cast<std::int32_t>(hn::CountTrue(df, carve));
    work.first[near_count] = static_cast<std::uint32_t>(n);
    work.lanes[near_count] = near;
    near_count += near != 0 ? 1 : 0;
  }
  return near_count;
}

// What the image shows at the nodes of the first `count` vectors listed that are near the surface, the image's first
// pixel at the others. Four bytes are read, of which the fourth is not looked at: the last pixel is read a byte early.
HWY_INLINE void look_up_colours(const UpdateCamera& c, std::size_t count, VU last, Work& work) {
  const DU du;
  const std::size_t lanes = hn::Lanes(du);
  for (std::size_t i = 0; i < count; ++i) {
    const VU pixel = hn::Load(du, work.at.pixel + work.first[i]);
    const VU number = number_of(pixel, static_cast<std::int32_t>(c.colour_stride_px));
    const VU triple = hn::Add(number, hn::Add(number, number));
    const VU at = hn::Add(triple, hn::VecFromMask(du, hn::Eq(triple, last)));
    const VU byte = hn::IfThenElseZero(lanes_of(work.lanes[i]), at);
    hn::Store(byte, du, work.byte + i * lanes);
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
    if (c.gather) {
      const auto* colour = reinterpret_cast<const std::uint32_t*>(c.colour);
      hn::Store(hn::GatherOffset(du, colour, hn::BitCast(DI(), byte)), du, work.shown + i * lanes);
    }
#endif
  }
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
  if (c.gather) return;
#endif
  __asm__ volatile("" ::: "memory");  // no gathers, see look_up()
  for (std::size_t n = 0; n < count * lanes; ++n) {
    std::uint32_t four = 0;
    std::memcpy(&four, c.colour + work.byte[n], 4);
    __asm__ volatile("" : "+r"(four));
    work.shown[n] = four;
  }
}

// Blends what the pixels show into the first `count` vectors listed.
HWY_INLINE void blend(const UpdateCamera& c, std::size_t count, std::uint32_t* colours,
                      Work& work) {
  const DU du;
  const DI di;
  const std::size_t lanes = hn::Lanes(du);
  // First byte of the image's last pixel.
  const VU last = hn::Set(
      du, 3U * static_cast<std::uint32_t>((c.height - 1) * c.colour_stride_px + c.width - 1));
  look_up_colours(c, count, last, work);
  const VU one = hn::Set(du, 1U), byte = hn::Set(du, 0xffU), early = hn::Sub(last, one);
  const auto low = [&](VU v) { return hn::And(v, byte); };
  for (std::size_t i = 0; i < count; ++i) {
    const VU four = hn::Load(du, work.shown + i * lanes),
             old = hn::LoadU(du, colours + work.first[i]);
    const VU now = hn::And(hn::IfThenElse(hn::Eq(hn::Load(du, work.byte + i * lanes), early),
                                          hn::ShiftRight<8>(four), four),
                           hn::Set(du, 0xffffffU));
    // What has no colour is 0 and adds nothing: the mean of the n before is what it was.
    const VU n = hn::ShiftRight<28>(old);
    const auto has = hn::VecFromMask(di, hn::Gt(hn::BitCast(di, now), hn::Zero(di)));
    const VU sum = hn::Sub(n, hn::BitCast(du, has));
    const VF fn = to_float(n), count_f = hn::Max(to_float(sum), set(1.0F));
    const VF inv = hn::Div(set(1.0F), count_f);
    // Below 2^12 over at most 16. Half a step up, rounded down where count is odd, and between a quarter and three of
    // one, which makes up for the rounding of the reciprocal: count - 1 of them and this are not one more.
    const VF half = mul(add(count_f, set(0.5F)), set(0.5F));
    const auto mean = [&](VU was, VU is) {
      const VF x = add(add(mul(to_float(was), fn), to_float(is)), half);
      return hn::BitCast(du, truncated(mul(x, inv)));
    };
    const VU r = mean(low(old), low(now)),
             g = mean(low(hn::ShiftRight<8>(old)), low(hn::ShiftRight<8>(now))),
             b = mean(low(hn::ShiftRight<16>(old)), hn::ShiftRight<16>(now));
    // Counted to 15: of 16 a sixteenth is taken off.
    const VU read = hn::Add(hn::ShiftRight<28>(hn::ShiftLeft<4>(old)), one);
    const auto capped = [](VU v) { return hn::Sub(v, hn::ShiftRight<4>(v)); };
    const VU counts = hn::Or(hn::ShiftLeft<24>(capped(read)), hn::ShiftLeft<28>(capped(sum)));
    const VU mixed = hn::Or(hn::Or(hn::Or(r, hn::ShiftLeft<8>(g)), hn::ShiftLeft<16>(b)), counts);
    hn::StoreU(hn::IfThenElse(lanes_of(work.lanes[i]), mixed, old), du, colours + work.first[i]);
  }
}

BlockCounts update_block_words(const UpdateCamera& c, const float (&p0)[3], bool inside,
                               std::uint32_t* words, std::uint64_t* free, std::uint32_t* colours) {
  BlockCounts counts;
  Work work;
  if (!project(c, p0, inside, work.at)) return counts;
  const std::size_t learning = list_learners(c, words, colours, work);
  const std::size_t near = update_words(c, learning, words, work, counts);
  for (std::size_t x = 0; x < 8; ++x) free[x] = (free[x] & ~work.clear[x]) | work.set[x];
  if (near == 0) return counts;
  blend(c, near, colours, work);
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
  const float u = x * c.fx + c.cx_half, v = y * c.fy + c.cy_half;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(c.width) && v < static_cast<float>(c.height)))
    return;
  const auto iu = static_cast<int>(u), iv = static_cast<int>(v);
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
    for (int a = 0; a < 3; ++a) p[a] = p0[a] + c.node[a][n];
    update_voxel(c, p, {words[n], colours[n], free[x], 1ULL << slice}, counts);
  }
  return counts;
}

BlockCounts update_block(const UpdateCamera& c, const float (&p0)[3], bool inside,
                         std::uint32_t* words, std::uint64_t* free,
                         std::uint32_t* colours) noexcept {
  // The vectors read a colour in four bytes: an image of one pixel has three. They count rows of colours in 16 bits.
  if (simd::chosen() == simd::Isa::kScalar || c.width * c.height == 1 ||
      c.colour_stride_px > 0x7fff)
    return update_block_scalar(c, p0, words, free, colours);
  return HWY_DYNAMIC_DISPATCH(update_block_words)(c, p0, inside, words, free, colours);
}

void UpdateCamera::place_nodes(const std::array<float, 3>& dx, const std::array<float, 3>& dy,
                               const std::array<float, 3>& dz) noexcept {
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t n = 0; n < 512; ++n)
      node[a][n] =
          (static_cast<float>(n >> 6U) * dx[a] + static_cast<float>((n >> 3U) & 7U) * dy[a]) +
          static_cast<float>(n & 7U) * dz[a];
}

}  // namespace perception
#endif
