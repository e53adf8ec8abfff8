// The nodes of a block on the image: what the vector kernels of integration and of the label votes
// share. Included once per instruction set (Highway's way: no guard but the toggle).
#include <cstdint>
#include <cstring>

#include "perception/tsdf/kernels/voxel_update.hpp"

#ifndef TELETACT_BLOCK_NODES_ONCE
#define TELETACT_BLOCK_NODES_ONCE
namespace perception {
namespace {

constexpr float kLeastZ = 0.05F;

}  // namespace
}  // namespace perception
#endif

#if defined(TELETACT_PROJECT_BLOCK_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_PROJECT_BLOCK_TOGGLE
#undef TELETACT_PROJECT_BLOCK_TOGGLE
#else
#define TELETACT_PROJECT_BLOCK_TOGGLE
#endif

#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

HWY_INLINE VF set(float x) { return hn::Set(DF(), x); }
HWY_INLINE VF add(VF a, VF b) { return hn::Add(a, b); }
HWY_INLINE VF mul(VF a, VF b) { return hn::Mul(a, b); }
HWY_INLINE VF to_float(VU v) { return hn::ConvertTo(DF(), hn::BitCast(DI(), v)); }
HWY_INLINE MF non_zero(VU v) { return hn::RebindMask(DF(), hn::Ne(v, hn::Zero(DU()))); }

// Bit n: lane n.
HWY_INLINE unsigned mask_bits(MF m) {
#if HWY_TARGET == HWY_AVX3
  return static_cast<unsigned>(m.raw);
#elif HWY_TARGET == HWY_AVX2
  return static_cast<unsigned>(_mm256_movemask_ps(m.raw));
#elif HWY_TARGET == HWY_SSE4
  return static_cast<unsigned>(_mm_movemask_ps(m.raw));
#else
  return bits_of(m);
#endif
}

// Row times stride and column, of row << 16 | column: both and the stride below 2^15.
HWY_INLINE VU number_of(VU pixel, std::int32_t stride) {
  const VU factors = hn::Set(DU(), static_cast<std::uint32_t>(stride) << 16U | 1U);
#if HWY_TARGET == HWY_AVX3
  return VU{_mm512_madd_epi16(pixel.raw, factors.raw)};
#elif HWY_TARGET == HWY_AVX2
  return VU{_mm256_madd_epi16(pixel.raw, factors.raw)};
#elif HWY_TARGET == HWY_SSE4
  return VU{_mm_madd_epi16(pixel.raw, factors.raw)};
#else
  return hn::Add(hn::Mul(hn::ShiftRight<16>(pixel), hn::ShiftRight<16>(factors)),
                 hn::And(pixel, hn::Set(DU(), 0xffffU)));
#endif
}

// What the block's nodes fall on.
struct Projected {
  HWY_ALIGN std::uint32_t reading[512];
  HWY_ALIGN std::uint32_t pixel[512];  // row << 16 | column; void where there is no reading
  HWY_ALIGN float z[512];
  HWY_ALIGN float stretch2[512];
};

// Number of the pixel onto which each node projects, for the vector that begins at node n. kInside:
// every node is known to project into the image.
template <bool kInside>
HWY_INLINE VU project_nodes(const UpdateCamera& c, const float (&p0)[3], std::size_t n,
                            Projected& out) {
  const DF df;
  const DU du;
  const VF one = set(1.0F), zero = hn::Zero(df);
  const VF px = add(set(p0[0]), hn::Load(df, c.node[0] + n)),
           py = add(set(p0[1]), hn::Load(df, c.node[1] + n)),
           pz = add(set(p0[2]), hn::Load(df, c.node[2] + n));
  const VF inv = hn::Div(one, pz);
  const VF x = mul(px, inv), y = mul(py, inv);
  const VF u = add(mul(x, set(c.fx)), set(c.cx_plus_half)),
           v = add(mul(y, set(c.fy)), set(c.cy_plus_half));
  const VU pixel = hn::BitCast(du, hn::Or(hn::ShiftLeft<16>(truncated(v)), truncated(u)));
  hn::Store(pixel, du, out.pixel + n);
  hn::Store(pz, df, out.z + n);
  hn::Store(add(add(one, mul(x, x)), mul(y, y)), df, out.stretch2 + n);
  const VU number = number_of(pixel, c.width);
  if (kInside) return number;
  const VF width = set(static_cast<float>(c.width)), height = set(static_cast<float>(c.height));
  const MF in =
      hn::And(hn::And(hn::Ge(pz, set(kLeastZ)), hn::And(hn::Ge(u, zero), hn::Ge(v, zero))),
              hn::And(hn::Lt(u, width), hn::Lt(v, height)));
  const VU spare = hn::Set(du, static_cast<std::uint32_t>(c.width * c.height));
  return hn::IfThenElse(hn::RebindMask(du, in), number, spare);
}

// Finds the reading and its pixel for all nodes, then calls `each(reading, n)` for every vector.
// Uses plain loads or the gather instruction, whichever is faster on this processor. The barriers
// keep the compiler from turning one into the other.
template <bool kInside, class Each>
HWY_INLINE void project(const UpdateCamera& c, const float (&p0)[3], Projected& out, Each&& each) {
  const DU du;
  const std::size_t lanes = hn::Lanes(du);
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
  if (c.gather) {
    for (std::size_t n = 0; n < 512; n += lanes) {
      const VU number = project_nodes<kInside>(c, p0, n, out);
      const VU reading = hn::GatherIndex(du, c.pixels, hn::BitCast(DI(), number));
      hn::Store(reading, du, out.reading + n);
      each(reading, n);
    }
    return;
  }
#endif
  for (std::size_t n = 0; n < 512; n += lanes)
    hn::Store(project_nodes<kInside>(c, p0, n, out), du, out.reading + n);
  __asm__ volatile("" ::: "memory");
  for (std::size_t n = 0; n < 512; n += 2) {
    std::uint64_t two =
        c.pixels[out.reading[n]] | static_cast<std::uint64_t>(c.pixels[out.reading[n + 1]]) << 32U;
    __asm__ volatile("" : "+r"(two));
    std::memcpy(out.reading + n, &two, sizeof two);
  }
  for (std::size_t n = 0; n < 512; n += lanes) each(hn::Load(du, out.reading + n), n);
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
