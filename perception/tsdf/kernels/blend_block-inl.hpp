// The colours of a block: the last step of its update (voxel_update.cpp).
// Included once per instruction set (Highway's way: no guard but the toggle).
#include <array>
#include <cstdint>
#include <cstring>

#if defined(TELETACT_BLEND_BLOCK_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_BLEND_BLOCK_TOGGLE
#undef TELETACT_BLEND_BLOCK_TOGGLE
#else
#define TELETACT_BLEND_BLOCK_TOGGLE
#endif

#include <hwy/highway.h>

#include "perception/tsdf/kernels/block_work-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

#if HWY_TARGET != HWY_SCALAR
// What the image shows at the nodes of a vector near the surface: the byte of each, the image's
// first pixel at other nodes. Four bytes are read, of which the fourth is not looked at: the last
// pixel is read a byte early.
HWY_INLINE VU byte_of(const UpdateCamera& c, VU early, std::size_t n, const Work& work) {
  const VU pixel = hn::Load(DU(), work.at.pixel + n);
  const VU number = number_of(pixel, static_cast<std::int32_t>(c.colour_stride_px));
  const VU triple = hn::Add(number, hn::Add(number, number));
  return hn::IfThenElseZero(lanes_of(get_bits(work.close, n)), hn::Min(triple, early));
}

// The sum of colours over how many there are, rounded: in 16 bits, by a multiplication.
struct Shares {
  std::uint32_t of[16] = {};  // [count & 15], twice
  static constexpr std::uint32_t of_count(std::uint32_t count) {
    return (0x8000U + count - 1) / count;
  }
  constexpr Shares() {
    for (std::uint32_t n = 1; n <= 16; ++n) of[n & 15U] = of_count(n) * 0x10001U;
  }
  // Is every mean of the readings that there can be exact?
  static constexpr bool exact() {
    for (std::uint32_t n = 1; n <= 16; ++n)
      for (std::uint32_t sum = 0; sum <= 255 * n + n / 2; ++sum)
        if (sum << 4U > 0xffffU || ((sum << 4U) * of_count(n)) >> 19U != sum / n) return false;
    return true;
  }
};
constexpr Shares kShares;
static_assert(Shares::exact());

HWY_INLINE VU share_of(VU count) {
  const DU du;
#if HWY_TARGET == HWY_AVX3
  return VU{_mm512_permutexvar_epi32(count.raw, hn::LoadU(du, kShares.of).raw)};
#else
  // Bytes: low and high of the share, by a table each.
  alignas(16) static constexpr auto kBytes = [] {
    std::array<std::array<std::uint8_t, 16>, 2> bytes{};
    for (std::size_t n = 0; n < 16; ++n) {
      bytes[0][n] = static_cast<std::uint8_t>(kShares.of[n]);
      bytes[1][n] = static_cast<std::uint8_t>(kShares.of[n] >> 8U);
    }
    return bytes;
  }();
  const hn::Repartition<std::uint8_t, DU> d8;
  const VU one = hn::And(count, hn::Set(du, 15U)), two = hn::Or(one, hn::ShiftLeft<16>(one));
  const auto at = hn::BitCast(d8, hn::Or(two, hn::ShiftLeft<8>(two)));
  const VU low = hn::BitCast(du, hn::TableLookupBytes(hn::LoadDup128(d8, kBytes[0].data()), at));
  const VU high = hn::BitCast(du, hn::TableLookupBytes(hn::LoadDup128(d8, kBytes[1].data()), at));
  return hn::Or(hn::And(low, hn::Set(du, 0xff00ffU)), hn::And(high, hn::Set(du, 0xff00ff00U)));
#endif
}

// Colours of a vector's nodes and how often they were read, with what the pixels show.
HWY_INLINE VU blended(VU old, VU now) {
  const DU du;
  const DI di;
  const hn::Repartition<std::uint16_t, DU> d16;
  const auto shorts = [d16](VU v) { return hn::BitCast(d16, v); };
  // What has no colour is 0 and adds nothing: the mean of the n before is what it was.
  const VU n = hn::ShiftRight<28>(old);
  const auto has = hn::RebindMask(du, hn::Gt(hn::BitCast(di, now), hn::Zero(di)));
  const VU counts = hn::Or(n, hn::ShiftLeft<16>(n));
  const VU sums = hn::Add(counts, hn::IfThenElseZero(has, hn::Set(du, 0x10001U)));
  const auto half = hn::ShiftRight<1>(shorts(sums)), share = shorts(share_of(sums));
  const auto mean = [&](VU was, VU is) {
    const auto sum = hn::Add(hn::Add(hn::Mul(shorts(was), shorts(counts)), shorts(is)), half);
    return hn::BitCast(du, hn::ShiftRight<3>(hn::MulHigh(hn::ShiftLeft<4>(sum), share)));
  };
  const VU even = hn::Set(du, 0xff00ffU), low = hn::Set(du, 0xffU);
  const VU rb = mean(hn::And(old, even), hn::And(now, even));
  const VU g = mean(hn::And(hn::ShiftRight<8>(old), low), hn::And(hn::ShiftRight<8>(now), low));
  // Counted to 15.
  const VU most = hn::Set(du, 15U);
  const VU read = hn::Add(hn::And(hn::ShiftRight<24>(old), most), hn::Set(du, 1U));
  const VU coloured = hn::Min(hn::And(sums, hn::Set(du, 31U)), most);
  return hn::Or(hn::Or(rb, hn::ShiftLeft<8>(g)),
                hn::Or(hn::ShiftLeft<24>(hn::Min(read, most)), hn::ShiftLeft<28>(coloured)));
}

HWY_INLINE void blend_into(VU four, VU byte, VU early, std::size_t n, const Work& work,
                           std::uint32_t* colours) {
  const DU du;
  const VU now = hn::And(hn::IfThenElse(hn::Eq(byte, early), hn::ShiftRight<8>(four), four),
                         hn::Set(du, 0xffffffU));
  const VU old = hn::LoadU(du, colours + n);
  const auto lanes = lanes_of(get_bits(work.close, n));
  hn::StoreU(hn::IfThenElse(lanes, blended(old, now), old), du, colours + n);
}

// Blends what the pixels show into the nodes near the surface.
HWY_INLINE void blend(const UpdateCamera& c, std::uint32_t* colours, Work& work) {
  const DU du;
  const List& near = work.near;
  // Three bytes a pixel; a byte before the last one's first.
  const VU early = hn::Set(
      du, 3U * static_cast<std::uint32_t>((c.height - 1) * c.colour_stride_px + c.width - 1) - 1U);
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
  if (c.gather) {
    const auto* image = reinterpret_cast<const std::int32_t*>(c.colour);
    for (std::size_t i = 0; i < near.size; ++i) {
      const VU byte = byte_of(c, early, near.first[i], work);
      const VI four = hn::GatherOffset(DI(), image, hn::BitCast(DI(), byte));
      blend_into(hn::BitCast(du, four), byte, early, near.first[i], work, colours);
    }
    return;
  }
#endif
  for (std::size_t i = 0; i < near.size; ++i)
    hn::Store(byte_of(c, early, near.first[i], work), du, work.byte + i * kWidth);
  __asm__ volatile("" ::: "memory");  // no gathers, see project()
  for (std::size_t n = 0; n < near.size * kWidth; ++n) {
    std::uint32_t four = 0;
    std::memcpy(&four, c.colour + work.byte[n], 4);
    __asm__ volatile("" : "+r"(four));
    work.shown[n] = four;
  }
  for (std::size_t i = 0; i < near.size; ++i)
    blend_into(hn::Load(du, work.shown + i * kWidth), hn::Load(du, work.byte + i * kWidth), early,
               near.first[i], work, colours);
}
#endif

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
