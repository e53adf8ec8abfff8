// What the steps of the block update (voxel_update.cpp) hand to each other.
// Included once per instruction set (Highway's way: no guard but the toggle).
#include <cstdint>
#include <cstring>
#include <type_traits>

#if defined(TELETACT_BLOCK_WORK_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_BLOCK_WORK_TOGGLE
#undef TELETACT_BLOCK_WORK_TOGGLE
#else
#define TELETACT_BLOCK_WORK_TOGGLE
#endif

#include <hwy/highway.h>

#include "perception/tsdf/kernels/project_block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

#if HWY_TARGET != HWY_SCALAR
constexpr std::size_t kWidth = hn::MaxLanes(DF());

// A bit a node.
using Bits = std::uint64_t[8];

// Those of the vector from node n on. What was set there is to be set again.
HWY_INLINE void put_bits(MF m, std::size_t n, Bits& bits) {
  if constexpr (kWidth >= 8) {
    const auto some =
        static_cast<std::conditional_t<kWidth == 16, std::uint16_t, std::uint8_t> >(mask_bits(m));
    std::memcpy(reinterpret_cast<unsigned char*>(bits) + n / 8, &some, sizeof some);
  } else {
    bits[n >> 6U] |= static_cast<std::uint64_t>(mask_bits(m)) << (n & 63U);
  }
}
HWY_INLINE unsigned get_bits(const Bits& bits, std::size_t n) {
  if constexpr (kWidth >= 8) {
    std::conditional_t<kWidth == 16, std::uint16_t, std::uint8_t> some;
    std::memcpy(&some, reinterpret_cast<const unsigned char*>(bits) + n / 8, sizeof some);
    return some;
  } else {
    return static_cast<unsigned>(bits[n >> 6U] >> (n & 63U)) & 0xfU;
  }
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

// First nodes of vectors.
struct List {
  std::uint32_t first[512 / kWidth + 1];
  std::size_t size = 0;
  // Without a branch: what a reading decides is hard to guess.
  HWY_INLINE void add_if(bool is, std::size_t n) {
    first[size] = static_cast<std::uint32_t>(n);
    size += is ? 1 : 0;
  }
};

// What is known of a block's nodes. Each step leaves a list for the next one.
struct Work {
  Projected at;                        // z: from the first step on how far the reading lies behind
  HWY_ALIGN std::uint32_t byte[512];   // of the image, for the vectors near the surface
  HWY_ALIGN std::uint32_t shown[512];  // there
  // Of the first step: may be fused, may take colour.
  Bits maybe{}, coloured{};
  // Seen to be free; fused; seen through though known; takes colour.
  Bits free{}, fused{}, carved{}, close{};
  List mixed, through, near;
};
#endif

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
