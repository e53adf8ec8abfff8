// The nodes of a block on the image: what the vector kernels of integration and of the label votes share.
// Included once per instruction set (Highway's way: no guard but the toggle).
#include <cmath>
#include <cstdint>
#include <cstring>

#include "perception/tsdf/voxel_update.hpp"

#ifndef TELETACT_BLOCK_NODES_ONCE
#define TELETACT_BLOCK_NODES_ONCE
namespace perception {
namespace {

constexpr float kLeastZ = 0.05F;

// y and z of the 64 nodes of one x slice.
struct Slice {
  alignas(64) float y[64];
  alignas(64) float z[64];
};
constexpr Slice make_slice() {
  Slice s{};
  for (int n = 0; n < 64; ++n) {
    s.y[n] = static_cast<float>(n >> 3);
    s.z[n] = static_cast<float>(n & 7);
  }
  return s;
}
constexpr Slice kSlice = make_slice();

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

// What the block's nodes fall on. Worked out for the whole block before anything depends on a reading, so
// that the loads of many nodes are under way at once.
struct Projected {
  HWY_ALIGN std::uint32_t reading[512];  // first the number of the pixel
  HWY_ALIGN std::uint32_t pixel[512];    // row << 16 | column
  HWY_ALIGN float z[512];
  HWY_ALIGN float stretch2[512];
};

// False: no node has a reading.
HWY_INLINE bool project(const UpdateCamera& c, const float (&p0)[3], Projected& out) {
  const DF df;
  const DI di;
  const DU du;
  const std::size_t lanes = hn::Lanes(df);
  const VF one = set(1.0F), half = set(0.5F);
  const VF umax = set(static_cast<float>(c.width) - 0.5F),
           vmax = set(static_cast<float>(c.height) - 0.5F);
  const VI spare = hn::Set(di, c.width * c.height);
  // y dy and z dz are the same in every slice.
  HWY_ALIGN float along_y[3][64];
  HWY_ALIGN float along_z[3][64];
  const float* const dy = c.dy;
  const float* const dz = c.dz;
  for (std::size_t n = 0; n < 64; n += lanes) {
    const VF ny = hn::Load(df, kSlice.y + n), nz = hn::Load(df, kSlice.z + n);
    for (int a = 0; a < 3; ++a) {
      hn::Store(mul(ny, set(dy[a])), df, along_y[a] + n);
      hn::Store(mul(nz, set(dz[a])), df, along_z[a] + n);
    }
  }
  for (std::size_t n = 0; n < 512; n += lanes) {
    const auto slice = static_cast<float>(n >> 6U);
    const std::size_t in_slice = n & 63U;
    const auto point = [&](int a) {
      return add(add(set(p0[a] + slice * c.dx[a]), hn::Load(df, along_y[a] + in_slice)),
                 hn::Load(df, along_z[a] + in_slice));
    };
    const VF px = point(0), py = point(1), pz = point(2);
    const MF ahead = hn::Ge(pz, set(kLeastZ));
    const VF inv = hn::Div(one, hn::IfThenElse(ahead, pz, one));
    const VF x = mul(px, inv), y = mul(py, inv);
    const VF u = add(mul(x, set(c.fx)), set(c.cx)), v = add(mul(y, set(c.fy)), set(c.cy));
    const MF in =
        hn::And(hn::And(ahead, hn::And(hn::Ge(u, hn::Neg(half)), hn::Ge(v, hn::Neg(half)))),
                hn::And(hn::Lt(u, umax), hn::Lt(v, vmax)));
    const auto nearest = [&](VF w) { return truncated(add(hn::IfThenElseZero(in, w), half)); };
    const VI iu = nearest(u), iv = nearest(v);
    const VI index = hn::Add(hn::Mul(iv, hn::Set(di, c.width)), iu);
    hn::Store(hn::BitCast(du, hn::IfThenElse(hn::RebindMask(di, in), index, spare)), du,
              out.reading + n);
    hn::Store(hn::BitCast(du, hn::Or(hn::ShiftLeft<16>(iv), iu)), du, out.pixel + n);
    hn::Store(pz, df, out.z + n);
    hn::Store(add(add(one, mul(x, x)), mul(y, y)), df, out.stretch2 + n);
  }
  // Numbers to readings. Plain loads: a gather takes twice as long on some processors, and not less on the
  // others. The barriers keep the compiler from making one.
  __asm__ volatile("" ::: "memory");
  std::uint64_t any = 0;
  for (std::size_t n = 0; n < 512; n += 2) {
    std::uint64_t two =
        c.pixels[out.reading[n]] | static_cast<std::uint64_t>(c.pixels[out.reading[n + 1]]) << 32U;
    __asm__ volatile("" : "+r"(two));
    std::memcpy(out.reading + n, &two, sizeof two);
    any |= two;
  }
  return any != 0;
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
