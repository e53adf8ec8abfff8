#include "perception/tsdf/kernels/voxel_update.hpp"

#include <algorithm>
#include <cmath>

#include "perception/geometry/no_colour.hpp"
#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/tsdf/kernels/voxel_update.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/tsdf/kernels/blend_block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

// Without vectors of 16 bytes at least (a processor older than SSE4): the reference itself.
#if HWY_TARGET == HWY_SCALAR
BlockCounts update_block_words(const UpdateCamera& c, const float (&p0)[3], bool /*inside*/,
                               const BlockMemory& block) {
  return update_block_scalar(c, p0, block);
}
#else

// truncation: of a 32nd of reach.
HWY_INLINE VF limit_of(VF truncation, VU reading) {
  return mul(truncation, to_float(hn::ShiftRight<24>(reading)));
}
HWY_INLINE VU depth_of(VU reading) { return hn::And(reading, hn::Set(DU(), 0xffffU)); }
HWY_INLINE VF distance_of(VU word) {
  const DI di;
  return hn::ConvertTo(DF(), hn::ShiftRight<16>(hn::BitCast(di, hn::ShiftLeft<16>(word))));
}

// Before and behind, as far as z alone tells: the stretch is at least 1, so what lies beyond the
// limit without it does so with it.
HWY_INLINE void sort_out(const UpdateCamera& c, VU reading, std::size_t n, Work& work) {
  const DF df;
  const VU depth = depth_of(reading);
  const MF seen = non_zero(depth);
  const VF dz = hn::Sub(mul(to_float(depth), set(0.001F)), hn::Load(df, work.at.z + n));
  hn::Store(dz, df, work.at.z + n);
  const VF limit = limit_of(set(c.truncation_m * 0.03125F), reading), away = hn::Abs(dz);
  const MF in_band = hn::And(seen, hn::Le(away, limit));
  put_bits(in_band, n, work.maybe);
  put_bits(hn::And(seen, hn::Gt(dz, limit)), n, work.free);
  put_bits(hn::And(in_band, hn::Le(away, set(c.colour_band_m))), n, work.coloured);
}

// Lists the vectors in which something may be learned.
HWY_INLINE void list_learners(const BlockMemory& block, Work& work) {
  List through;
  for (std::size_t n = 0; n < 512; n += kWidth) {
    const unsigned maybe = get_bits(work.maybe, n), front = get_bits(work.free, n);
    work.mixed.add_if(maybe != 0, n);
    through.add_if(maybe == 0 && front != 0, n);
    // Its memory is asked for, if it may take colour.
    __builtin_prefetch(block.colours + (get_bits(work.coloured, n) != 0 ? n : 0), 1);
  }
  for (std::size_t i = 0; i < through.size; ++i) {
    const std::size_t n = through.first[i];
    const MF known = non_zero(hn::ShiftRight<16>(hn::LoadU(DU(), block.words + n)));
    work.through.add_if((mask_bits(known) & get_bits(work.free, n)) != 0, n);
  }
}

// The word of distance d and weight w after a reading of value and weight, void where both weights
// are 0.
HWY_INLINE VU mean_word(VU cap, VF d, VU w, VF value, VU w_new) {
  const DU du;
  const VU w_sum = hn::Add(w, w_new);
  const VF mean = hn::Div(add(mul(d, to_float(w)), mul(value, to_float(w_new))), to_float(w_sum));
  const VI rounded = truncated(add(mean, hn::CopySignToAbs(set(0.5F), mean)));
  return hn::Or(hn::And(hn::BitCast(du, rounded), hn::Set(du, 0xffffU)),
                hn::ShiftLeft<16>(hn::Min(w_sum, cap)));
}

// Vectors that a surface may lie in: distances and weights; lists those near to one.
HWY_INLINE void fuse(const UpdateCamera& c, std::uint32_t* words, Work& work) {
  const DF df;
  const DU du;
  const VF zero = hn::Zero(df), most = set(32767.0F);
  const VF units_per_m = set(c.units_per_m), band_c = set(c.colour_band_m);
  const VF truncation = set(c.truncation_m * 0.03125F), square = set(c.truncation_m);
  const VU through = hn::Set(du, kSeenThrough), going = hn::Set(du, kGoing),
           cap = hn::Set(du, static_cast<std::uint32_t>(c.weight_cap));
  std::size_t near_count = 0;  // here, not in memory
  for (std::size_t i = 0, count = work.mixed.size; i < count; ++i) {
    const std::size_t n = work.mixed.first[i];
    const VU reading = hn::Load(du, work.at.reading + n), word = hn::LoadU(du, words + n);
    const MF seen = non_zero(depth_of(reading));
    const VF limit = limit_of(truncation, reading);
    const VF sdf = mul(hn::Load(df, work.at.z + n), hn::Sqrt(hn::Load(df, work.at.stretch2 + n)));
    const VF away = hn::Abs(sdf);
    const VU w_pixel = hn::And(hn::ShiftRight<16>(reading), hn::Set(du, 0xffU));
    const VU w = hn::ShiftRight<16>(word);
    const VF d = distance_of(word);
    // What is unknown has d = 0.
    const MF front = hn::And(seen, hn::Gt(sdf, hn::IfNegativeThenElse(d, square, limit)));
    const MF band =
        hn::AndNot(front, hn::And(hn::And(seen, non_zero(w_pixel)), hn::Le(away, limit)));
    const MF carve = hn::And(front, non_zero(w));
    const auto in_band = hn::RebindMask(du, band);
    const VU w_new = hn::IfThenElse(in_band, w_pixel, through);
    const VU w_old = hn::IfThenElse(in_band, w, hn::Min(w, going));
    const VF clipped = hn::Max(hn::Min(mul(sdf, units_per_m), most), hn::Neg(most));
    const VU updated = mean_word(cap, d, w_old, hn::IfThenElse(band, clipped, most), w_new);
    const MF learns = hn::Or(band, carve);
    hn::StoreU(hn::IfThenElse(hn::RebindMask(du, learns), updated, word), du, words + n);
    put_bits(hn::Or(front, hn::And(band, hn::Gt(sdf, zero))), n, work.free);
    put_bits(band, n, work.fused);
    put_bits(carve, n, work.carved);
    const MF near = hn::And(band, hn::Le(away, band_c));
    put_bits(near, n, work.close);
    work.near.first[near_count] = static_cast<std::uint32_t>(n);
    near_count += mask_bits(near) != 0 ? 1 : 0;
  }
  work.near.size = near_count;
}

// Vectors with all that is seen of them in front, and something known in them.
HWY_INLINE void see_through(const UpdateCamera& c, std::uint32_t* words, Work& work) {
  const DU du;
  const VU cap = hn::Set(du, static_cast<std::uint32_t>(c.weight_cap));
  for (std::size_t i = 0; i < work.through.size; ++i) {
    const std::size_t n = work.through.first[i];
    const VU word = hn::LoadU(du, words + n);
    const MF carve = hn::And(hn::RebindMask(DF(), lanes_of(get_bits(work.free, n))),
                             non_zero(hn::ShiftRight<16>(word)));
    const VU w = hn::Min(hn::ShiftRight<16>(word), hn::Set(du, kGoing));
    const VU updated =
        mean_word(cap, distance_of(word), w, set(32767.0F), hn::Set(du, kSeenThrough));
    hn::StoreU(hn::IfThenElse(hn::RebindMask(du, carve), updated, word), du, words + n);
    put_bits(carve, n, work.carved);
  }
}

template <bool kInside>
HWY_INLINE BlockCounts update(const UpdateCamera& c, const float (&p0)[3],
                              const BlockMemory& block) {
  Work work;
  // The next block's memory is asked for line by line: all at once, the processor would wait.
  project<kInside>(c, p0, work.at, [&](VU reading, std::size_t n) {
    __builtin_prefetch(block.next_words + n, 1);
    sort_out(c, reading, n, work);
  });
  list_learners(block, work);
  fuse(c, block.words, work);
  see_through(c, block.words, work);
  BlockCounts counts;
  for (std::size_t x = 0; x < 8; ++x) {
    block.free[x] = (block.free[x] & ~work.fused[x]) | work.free[x];
    counts.fused += __builtin_popcountll(work.fused[x]);
    counts.carved += __builtin_popcountll(work.carved[x]);
  }
  if (work.near.size > 0) blend(c, block.colours, work);
  return counts;
}

BlockCounts update_block_words(const UpdateCamera& c, const float (&p0)[3], bool inside,
                               const BlockMemory& block) {
  return inside ? update<true>(c, p0, block) : update<false>(c, p0, block);
}

#endif  // HWY_TARGET

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
  const float u = x * c.fx + c.cx_plus_half, v = y * c.fy + c.cy_plus_half;
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
  const bool front = sdf > (d < 0 ? c.truncation_m : limit);
  const bool band = !front && w_pixel != 0 && sdf <= limit && sdf >= -limit;
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
  const std::int32_t w_old = band ? w : std::min(w, static_cast<std::int32_t>(kGoing));
  const std::int32_t w_sum = w_old + w_new;
  const float mean =
      (static_cast<float>(d) * static_cast<float>(w_old) + value * static_cast<float>(w_new)) /
      static_cast<float>(w_sum);
  const auto rounded = static_cast<std::int32_t>(mean + (mean >= 0.0F ? 0.5F : -0.5F));
  voxel.word = (static_cast<std::uint32_t>(rounded) & 0xffffU) |
               static_cast<std::uint32_t>(std::min(w_sum, c.weight_cap)) << 16U;
  if (band && sdf <= c.colour_band_m && sdf >= -c.colour_band_m)
    voxel.colour = blend_colour(voxel.colour, c.colour + 3 * (iv * c.colour_stride_px + iu));
}

}  // namespace

BlockCounts update_block_scalar(const UpdateCamera& c, const float (&p0)[3],
                                const BlockMemory& block) noexcept {
  BlockCounts counts;
  for (std::size_t n = 0; n < 512; ++n) {
    const std::size_t x = n >> 6U, slice = n & 63U;
    float p[3];
    for (int a = 0; a < 3; ++a) p[a] = p0[a] + c.node[a][n];
    update_voxel(c, p, {block.words[n], block.colours[n], block.free[x], 1ULL << slice}, counts);
  }
  return counts;
}

BlockCounts update_block(const UpdateCamera& c, const float (&p0)[3], bool inside,
                         const BlockMemory& block) noexcept {
  // The vectors read a colour in four bytes: an image of one pixel has three. They count rows of
  // colours in 16 bits.
  if (simd::chosen() == simd::Isa::kScalar || c.width * c.height == 1 ||
      c.colour_stride_px > 0x7fff)
    return update_block_scalar(c, p0, block);
  return HWY_DYNAMIC_DISPATCH(update_block_words)(c, p0, inside, block);
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
