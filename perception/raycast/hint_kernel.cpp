#include "perception/raycast/hint_kernel.hpp"

#include <cstring>

#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/raycast/hint_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/raycast/hint_cells-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

HWY_INLINE MF mask_of(unsigned bits) {
  const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits),
                                 static_cast<std::uint8_t>(bits >> 8U)};
  return hn::LoadMaskBits(DF(), bytes);
}
#if HWY_TARGET == HWY_AVX2
// By mask: its lanes, rising, a byte each.
struct LanesOf {
  std::uint64_t lanes[256] = {};
  constexpr LanesOf() {
    for (unsigned m = 0; m < 256; ++m)
      for (unsigned n = 0, to = 0; n < 8; ++n)
        if ((m >> n & 1U) != 0) lanes[m] |= std::uint64_t{n} << (8 * to++);
  }
};
constexpr LanesOf kLanesOf;
#endif

// Moves the lanes of a mask to the front. Highway's own version for 8 lanes copies its table to the
// stack each time.
class Packer {
 public:
  HWY_INLINE explicit Packer(MF keep) : keep_(keep) {
#if HWY_TARGET == HWY_AVX2
    const hn::Rebind<std::uint8_t, DI> d8;
    const std::uint64_t lanes = kLanesOf.lanes[bits_of(keep)];
    HWY_ALIGN std::uint8_t bytes[8];
    std::memcpy(bytes, &lanes, 8);
    order_ = hn::PromoteTo(DI(), hn::Load(d8, bytes));
#endif
  }
  template <class D, class Vector, class T>
  HWY_INLINE void store(D d, Vector v, T* to) const {
#if HWY_TARGET == HWY_AVX2
    hn::StoreU(hn::TableLookupLanes(v, hn::IndicesFromVec(d, order_)), d, to);
#else
    hn::StoreU(hn::Compress(v, hn::RebindMask(d, keep_)), d, to);
#endif
  }

 private:
  MF keep_;
#if HWY_TARGET == HWY_AVX2
  VI order_;
#endif
};

// The rays of `keep` go to the end of `out`.
HWY_INLINE void append(Rays& out, MF keep, const VF (&d)[3], VF t, VF low, VF high, VF small,
                       VI ray) {
  const DF df;
  const Packer pack(keep);
  const int at = out.size;
  for (int a = 0; a < 3; ++a) pack.store(df, d[a], out.d[a] + at);
  pack.store(df, t, out.t + at), pack.store(df, low, out.low + at);
  pack.store(df, high, out.high + at), pack.store(df, small, out.small + at);
  pack.store(DI(), ray, out.ray + at);
  out.size = at + static_cast<int>(hn::CountTrue(df, keep));
}

// What they found, by ray.
struct Found {
  alignas(64) float t[kRoom], g[3][kRoom];  // t = 0: nothing
};

// A Newton step for the vector of rays from `at` on that are in `active`. Rays that have converged
// go to `found`, rays that may continue to `out`. kOwn: each ray is at its own place.
template <bool kOwn>
HWY_INLINE void newton(const HintJob& job, const Rays& rays, const Cells& cells, int at, MF active,
                       Found& found, Rays& out) {
  const DF df;
  const DI di;
  const VF d[3] = {hn::Load(df, rays.d[0] + at), hn::Load(df, rays.d[1] + at),
                   hn::Load(df, rays.d[2] + at)};
  const VF low = hn::Load(df, rays.low + at), high = hn::Load(df, rays.high + at),
           small = hn::Load(df, rays.small + at);
  const Value c = value_at(job, cells, at);
  const VF slope =
      hn::Add(hn::Add(hn::Mul(c.g[0], d[0]), hn::Mul(c.g[1], d[1])), hn::Mul(c.g[2], d[2]));
  active = hn::And(active, mask_of(static_cast<unsigned>(cells.inside >> at)));
  active = hn::And(active, hn::And(c.known, hn::Lt(slope, hn::Zero(df))));
  const VF move = hn::Div(hn::Neg(c.f), hn::IfThenElse(active, slope, hn::Set(df, -1.0F)));
  const VF next = hn::Add(hn::Load(df, rays.t + at), move);
  active = hn::And(active, hn::And(hn::Ge(next, low), hn::Le(next, high)));
  const MF close = hn::And(active, hn::And(hn::Lt(move, small), hn::Gt(move, hn::Neg(small))));
  if constexpr (kOwn) {
    hn::Store(hn::IfThenElseZero(close, next), df, found.t + at);
    for (int a = 0; a < 3; ++a) hn::Store(hn::IfThenElseZero(close, c.g[a]), df, found.g[a] + at);
  } else {
    HWY_ALIGN float hit[4][16];
    hn::Store(next, df, hit[0]);
    for (int a = 0; a < 3; ++a) hn::Store(c.g[a], df, hit[a + 1]);
    for (unsigned bits = bits_of(close); bits != 0; bits &= bits - 1) {
      const auto n = static_cast<std::size_t>(__builtin_ctz(bits));
      const auto to = static_cast<std::size_t>(rays.ray[static_cast<std::size_t>(at) + n]);
      found.t[to] = hit[0][n];
      for (std::size_t a = 0; a < 3; ++a) found.g[a][to] = hit[a + 1][n];
    }
  }
  append(out, hn::AndNot(close, active), d, next, low, high, small, hn::Load(di, rays.ray + at));
}

// Start and end of each ray; rays that are not tried get t = 0. Returns one bit a ray: tried or
// not.
HWY_INLINE std::uint64_t set_out(const HintJob& job, const HintSpan& span, Rays& rays) {
  const DF df;
  const DI di;
  const VF half = hn::Set(df, 0.5F), y = hn::Set(df, span.y);
  std::uint64_t tried = 0;
  for (int u = 0; u < span.count; u += kWidth) {
    const VF hint = hn::LoadU(df, span.hint + u), x = hn::LoadU(df, span.x + u);
    VF d[3];
    for (int a = 0; a < 3; ++a) {
      d[a] = hn::Add(
          hn::Add(hn::Mul(x, hn::Set(df, job.axes[0][a])), hn::Mul(y, hn::Set(df, job.axes[1][a]))),
          hn::Set(df, job.axes[2][a]));
      hn::Store(d[a], df, rays.d[a] + u);
    }
    const VF dd = hn::Add(hn::Add(hn::Mul(d[0], d[0]), hn::Mul(d[1], d[1])), hn::Mul(d[2], d[2]));
    const VF voxel_t = hn::Div(hn::Set(df, 1.0F), hn::Sqrt(dd));
    const VF near = hn::Mul(hn::Set(df, job.reach), voxel_t);
    const VF from = hn::Sub(hint, near), to = hn::Add(hint, near);
    const MF active =
        hn::And(hn::Gt(hint, hn::Zero(df)),
                hn::And(hn::Gt(from, hn::Set(df, job.first)), hn::Lt(to, hn::Set(df, job.last))));
    tried |= static_cast<std::uint64_t>(bits_of(active)) << u;
    hn::Store(hn::IfThenElseZero(active, hint), df, rays.t + u);
    hn::Store(hn::Sub(from, hn::Mul(half, voxel_t)), df, rays.low + u);
    hn::Store(hn::Add(to, hn::Mul(half, voxel_t)), df, rays.high + u);
    hn::Store(hn::Mul(hn::Set(df, HintJob::kClose), voxel_t), df, rays.small + u);
    hn::Store(hn::Iota(di, u), di, rays.ray + u);
  }
  rays.size = span.count;
  return tried;
}

HWY_INLINE void store_records(const VF (&n)[3], VF t, int count, float* records) {
  const DF df;
  if (count == static_cast<int>(hn::Lanes(df))) {
    hn::StoreInterleaved4(n[0], n[1], n[2], t, df, records);
    return;
  }
  HWY_ALIGN float all[4 * 16];
  hn::StoreInterleaved4(n[0], n[1], n[2], t, df, all);
  std::memcpy(records, all, static_cast<std::size_t>(count) * 4 * sizeof(float));
}

// Normal and depth of what was found.
HWY_INLINE std::int32_t finish(const HintJob& job, const HintSpan& span, const Found& found) {
  const DF df;
  const DI di;
  const VF one = hn::Set(df, 1.0F), y = hn::Set(df, span.y);
  std::int32_t hits = 0;
  for (int u = 0; u < span.count; u += kWidth) {
    const VF t = hn::Load(df, found.t + u), x = hn::LoadU(df, span.x + u);
    const MF done = hn::Gt(t, hn::Zero(df));  // before the first depth there is no hit
    const VF g[3] = {hn::Load(df, found.g[0] + u), hn::Load(df, found.g[1] + u),
                     hn::Load(df, found.g[2] + u)};
    VF n[3];
    for (int c = 0; c < 3; ++c) {
      n[c] = hn::Add(
          hn::Add(hn::Mul(hn::Set(df, job.R[0][c]), g[0]), hn::Mul(hn::Set(df, job.R[1][c]), g[1])),
          hn::Mul(hn::Set(df, job.R[2][c]), g[2]));
    }
    const VF length =
        hn::Sqrt(hn::Add(hn::Add(hn::Mul(n[0], n[0]), hn::Mul(n[1], n[1])), hn::Mul(n[2], n[2])));
    const VF facing = hn::Add(hn::Add(hn::Mul(n[0], x), hn::Mul(n[1], y)), n[2]);
    const MF hit =
        hn::And(done, hn::And(hn::Gt(length, hn::Zero(df)), hn::Lt(facing, hn::Zero(df))));
    const VF divide = hn::IfThenElse(hit, length, one);
    for (VF& a : n) a = hn::IfThenElseZero(hit, hn::Div(a, divide));
    const int here = span.count - u < kWidth ? span.count - u : kWidth;
    store_records(n, hn::IfThenElseZero(hit, t), here, span.records + 4 * u);
    hits += static_cast<std::int32_t>(hn::CountTrue(df, hit));
    const VI settled = hn::IfThenElseZero(hn::RebindMask(di, done), hn::Set(di, 1));
    const hn::Rebind<std::uint8_t, DI> bytes;
    hn::StoreU(hn::DemoteTo(bytes, settled), bytes, span.found + u);
  }
  return hits;
}

HintCount cast_hints_job(const HintJob& job, const HintSpan& span) {
  const DF df;
  Rays rays[2];
  Cells cells;
  Found found;
  HintCount count;
  // Written last: until then they are on their way.
  for (int n = 0; n < 4 * span.count; n += 16) __builtin_prefetch(span.records + n, 1);
  const std::uint64_t tried = set_out(job, span, rays[0]);
  count.steps = __builtin_popcountll(tried);
  find_cells(job, rays[0], cells);
  for (int at = 0; at < span.count; at += kWidth)
    newton<true>(job, rays[0], cells, at, mask_of(static_cast<unsigned>(tried >> at)), found,
                 rays[1]);
  for (int n = 1; n < HintJob::kNewton && rays[n & 1].size > 0; ++n) {
    const Rays& now = rays[n & 1];
    Rays& next = rays[(n + 1) & 1];
    next.size = 0;
    count.steps += now.size;
    find_cells(job, now, cells);
    for (int at = 0; at < now.size; at += kWidth) {
      const MF active = hn::FirstN(df, static_cast<std::size_t>(now.size - at));
      newton<false>(job, now, cells, at, active, found, next);
    }
  }
  count.hits = finish(job, span, found);
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {
HWY_EXPORT(cast_hints_job);
}  // namespace
HintCount cast_hints(const HintJob& job, const HintSpan& span) noexcept {
  return HWY_DYNAMIC_DISPATCH(cast_hints_job)(job, span);
}
}  // namespace perception
#endif
