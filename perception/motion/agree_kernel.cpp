#include "perception/motion/agree_kernel.hpp"

#include <bit>
#include <cmath>

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/motion/agree_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception::motion {
namespace HWY_NAMESPACE {

// Without vectors of 16 bytes at least: the reference itself.
#if HWY_TARGET == HWY_SCALAR
void find_agreeing_job(const AgreeJob& job, MapReader& reader, RowBits* rows) {
  find_agreeing_plain(job, reader, rows);
}
#else

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kAcross>;  // a row of a cell is one vector, or two
using DInt = hn::RebindToSigned<D>;
using DBits = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using I = hn::Vec<DInt>;
using M = hn::Mask<D>;
constexpr int kWidth = static_cast<int>(hn::MaxLanes(D()));
constexpr unsigned kAll = (1U << static_cast<unsigned>(kWidth)) - 1;

HWY_INLINE unsigned bits(M m) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(D(), m, bytes);
  return bytes[0];
}
// Towards zero, of values within int range.
HWY_INLINE I truncated(V x) {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
  return I{_mm256_cvttps_epi32(x.raw)};
#elif HWY_TARGET == HWY_SSE4
  return I{_mm_cvttps_epi32(x.raw)};
#else
  return hn::ConvertTo(DInt(), x);
#endif
}
HWY_INLINE V set(float x) { return hn::Set(D(), x); }

// std::lround of values far below 2^23.
HWY_INLINE I nearest(V x) {
  const V whole = hn::Trunc(x), rest = hn::Sub(x, whole);
  const V up = hn::IfThenElseZero(hn::Ge(rest, set(0.5F)), set(1));
  const V down = hn::IfThenElseZero(hn::Le(rest, set(-0.5F)), set(1));
  return truncated(hn::Sub(hn::Add(whole, up), down));
}
HWY_INLINE V turn(const float* R, float t, V x, V y, V z) {
  const V yz = hn::Add(hn::Mul(set(R[1]), y), hn::Mul(set(R[2]), z));
  return hn::Add(hn::Add(hn::Mul(set(R[0]), x), yz), set(t));
}

// The words of the nodes (i, j, k), of the lanes in `valid`; 0 where there is no block.
HWY_INLINE I words_of(I i, I j, I k, unsigned valid, MapReader& reader) {
  const DInt d;
  const I seven = hn::Set(d, 7);
  const I in_block =
      hn::Or(hn::Or(hn::ShiftLeft<6>(hn::And(i, seven)), hn::ShiftLeft<3>(hn::And(j, seven))),
             hn::And(k, seven));
  const I x = hn::ShiftRight<3>(i), y = hn::ShiftRight<3>(j), z = hn::ShiftRight<3>(k);
  HWY_ALIGN std::int32_t bx[kWidth], by[kWidth], bz[kWidth], at[kWidth], word[kWidth];
  hn::Store(x, d, bx), hn::Store(y, d, by), hn::Store(z, d, bz), hn::Store(in_block, d, at);
  hn::Store(hn::Zero(d), d, word);
  while (valid != 0) {  // the lanes of one block after the other: neighbours share theirs
    const auto n = static_cast<unsigned>(std::countr_zero(valid));
    const std::uint32_t* block = reader.block_of(bx[n], by[n], bz[n]);
    const auto here = hn::And(hn::And(hn::Eq(x, hn::Set(d, bx[n])), hn::Eq(y, hn::Set(d, by[n]))),
                              hn::Eq(z, hn::Set(d, bz[n])));
    unsigned lanes = bits(hn::RebindMask(D(), here)) & valid;
    valid &= ~lanes;
    if (block == nullptr) continue;
    if (lanes == kAll) {
#pragma GCC unroll 8
      for (int l = 0; l < kWidth; ++l) word[l] = static_cast<std::int32_t>(block[at[l]]);
      break;
    }
    for (; lanes != 0; lanes &= lanes - 1) {
      const auto l = static_cast<unsigned>(std::countr_zero(lanes));
      word[l] = static_cast<std::int32_t>(block[at[l]]);
    }
  }
  return hn::Load(d, word);
}

// Of the lanes in `valid`: those of whose place something may be remembered.
HWY_INLINE unsigned remembered(const AgreeJob& job, V wx, V wy, V wz, unsigned valid) {
  const DBits d;
  const V inv = set(job.inv_place);
  const auto cell = [&](V w, std::uint32_t prime) {
    return hn::Mul(hn::BitCast(d, truncated(hn::Floor(hn::Mul(w, inv)))), hn::Set(d, prime));
  };
  const auto h = hn::Xor(hn::Xor(cell(wx, 73856093U), cell(wy, 19349663U)), cell(wz, 83492791U));
  HWY_ALIGN std::uint32_t slot[kWidth];
  hn::Store(hn::And(hn::Xor(h, hn::ShiftRight<15>(h)), hn::Set(d, kPlaceSlots - 1)), d, slot);
  unsigned out = 0;
#pragma GCC unroll 8
  for (unsigned l = 0; l < kWidth; ++l)
    out |= (job.places[slot[l] >> 5U] >> (slot[l] & 31U) & 1U) << l;
  return out & valid;
}

void find_agreeing_job(const AgreeJob& job, MapReader& reader, RowBits* rows) {
  const D d;
  const DInt di;
  for (unsigned left = job.rows; left != 0; left &= left - 1) {
    const int r = std::countr_zero(left);
    const float* at = job.z + r * job.stride;
    const V y_factor = set(job.y_factor[r]);
    unsigned agrees = 0, others = 0;
    for (int u = 0; u < kAcross; u += kWidth) {
      const V z = hn::LoadU(d, at + u);
      const unsigned valid = bits(hn::Gt(z, hn::Zero(d)));
      if (valid == 0) continue;
      const V x = hn::Mul(hn::LoadU(d, job.x_factor + u), z), y = hn::Mul(y_factor, z);
      const V wx = turn(job.R_W, job.t_W[0], x, y, z), wy = turn(job.R_W + 3, job.t_W[1], x, y, z),
              wz = turn(job.R_W + 6, job.t_W[2], x, y, z);
      const V inv = set(job.inv_voxel);
      const I word = words_of(nearest(hn::Mul(wx, inv)), nearest(hn::Mul(wy, inv)),
                              nearest(hn::Mul(wz, inv)), valid, reader);
      const V distance = hn::Mul(hn::ConvertTo(d, hn::ShiftRight<16>(hn::ShiftLeft<16>(word))),
                                 set(job.metres_per_unit));
      const I weight = hn::And(hn::ShiftRight<16>(word), hn::Set(di, 0xffff));
      const V beyond = hn::Max(hn::Sub(z, set(job.from_m)), hn::Zero(d));
      const V enough = hn::Add(set(job.base_m), hn::Mul(set(job.per_m2), hn::Mul(beyond, beyond)));
      const unsigned known =
          bits(hn::RebindMask(d, hn::Gt(weight, hn::Set(di, reader.least_weight() - 1))));
      unsigned near = bits(hn::Lt(hn::Abs(distance), enough)) & known & valid;
      if (job.places != nullptr) near &= ~remembered(job, wx, wy, wz, valid);
      agrees |= near << static_cast<unsigned>(u);
      others |= (valid & ~near) << static_cast<unsigned>(u);
    }
    rows[r] = {static_cast<std::uint8_t>(agrees), static_cast<std::uint8_t>(others)};
  }
}

#endif  // HWY_TARGET
}  // namespace HWY_NAMESPACE
}  // namespace perception::motion
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception::motion {
namespace {
HWY_EXPORT(find_agreeing_job);
}  // namespace

void find_agreeing_plain(const AgreeJob& job, MapReader& reader, RowBits* rows) noexcept {
  for (unsigned left = job.rows; left != 0; left &= left - 1) {
    const int r = std::countr_zero(left);
    rows[r] = {0, 0};
    for (unsigned u = 0; u < kAcross; ++u) {
      const float z = job.z[r * job.stride + u];
      if (!(z > 0)) continue;
      const float x = job.x_factor[u] * z, y = job.y_factor[r] * z;
      float p[3];
      for (int a = 0; a < 3; ++a) p[a] = turned(job.R_W + 3 * a, job.t_W[a], x, y, z);
      const auto node = [&](int a) { return static_cast<int>(std::lround(p[a] * job.inv_voxel)); };
      const std::uint32_t word = reader.word(node(0), node(1), node(2));
      const float beyond = std::fmax(z - job.from_m, 0.0F);
      const float distance =
          static_cast<float>(MapLayout::word_distance(word)) * job.metres_per_unit;
      bool near =
          reader.known(word) && std::fabs(distance) < job.base_m + job.per_m2 * (beyond * beyond);
      if (job.places != nullptr) {
        const auto cell = [&](int a) {
          return static_cast<std::int32_t>(std::floor(p[a] * job.inv_place));
        };
        const std::uint32_t slot = place_slot(cell(0), cell(1), cell(2));
        near = near && (job.places[slot >> 5U] >> (slot & 31U) & 1U) == 0;
      }
      (near ? rows[r].agrees : rows[r].others) |= static_cast<std::uint8_t>(1U << u);
    }
  }
}

void find_agreeing(const AgreeJob& job, MapReader& reader, RowBits* rows) noexcept {
  if (simd::chosen() == simd::Isa::kScalar)
    find_agreeing_plain(job, reader, rows);
  else
    HWY_DYNAMIC_DISPATCH(find_agreeing_job)(job, reader, rows);
}

}  // namespace perception::motion
#endif
