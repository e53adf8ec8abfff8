#include "perception/icp/kernels.hpp"

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/icp/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception::icp {
namespace HWY_NAMESPACE {

// Without vectors of 16 bytes at least (a processor older than SSE4): the reference itself.
#if HWY_TARGET == HWY_SCALAR
void accumulate_job(const RowsJob& job, bool cross, LaneSums& out) {
  kScalarKernels.accumulate(job, cross, out);
}
void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                   int radius, const EdgeRule& rule, float* out) {
  kScalarKernels.bilateral_row(in, stride, width, weight, radius, rule, out);
}
void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x, const float* y,
                const EdgeRule& rule, float* nx, float* ny, float* nz) {
  kScalarKernels.normal_row(z, stride, width, x, y, rule, nx, ny, nz);
}
void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
  kScalarKernels.to_metres_row(mm, width, min_m, max_m, out);
}
void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
  kScalarKernels.half_row(in, stride, width, rule, out);
}
#else

namespace hn = hwy::HWY_NAMESPACE;
using perception::HWY_NAMESPACE::truncated;
using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DH = hn::Half<DF>;
using DD = hn::Rebind<double, DH>;
using D4 = hn::FixedTag<float, 4>;
using V = hn::Vec<DF>;
using M = hn::Mask<DF>;
constexpr int kWidth = static_cast<int>(hn::MaxLanes(DF()));  // lanes of a vector
static_assert(kLanes % kWidth == 0);

HWY_INLINE V set(float x) { return hn::Set(DF(), x); }
HWY_INLINE V zero() { return hn::Zero(DF()); }
HWY_INLINE V load(const float* p) { return hn::LoadU(DF(), p); }
HWY_INLINE V add(V a, V b) { return hn::Add(a, b); }
HWY_INLINE V sub(V a, V b) { return hn::Sub(a, b); }
HWY_INLINE V mul(V a, V b) { return hn::Mul(a, b); }
HWY_INLINE V keep(M m, V v) { return hn::IfThenElseZero(m, v); }
HWY_INLINE int count(M m) { return static_cast<int>(hn::CountTrue(DF(), m)); }

struct V3 {
  V x, y, z;
};
HWY_INLINE V dot(V3 a, V3 b) { return add(add(mul(a.x, b.x), mul(a.y, b.y)), mul(a.z, b.z)); }
HWY_INLINE V row3(const float* R, V3 p) {
  return add(add(mul(set(R[0]), p.x), mul(set(R[1]), p.y)), mul(set(R[2]), p.z));
}
HWY_INLINE void fill_row(M ok, V3 n, V3 a, V (&J)[6]) {
  J[0] = keep(ok, n.x), J[1] = keep(ok, n.y), J[2] = keep(ok, n.z);
  J[3] = keep(ok, sub(mul(a.y, n.z), mul(a.z, n.y)));
  J[4] = keep(ok, sub(mul(a.z, n.x), mul(a.x, n.z)));
  J[5] = keep(ok, sub(mul(a.x, n.y), mul(a.y, n.x)));
}

// Lanes 0, 4, 8, ... of `offset`: four floats each at base + offset.
HWY_INLINE V quads(const float* base, const std::uint32_t* offset) {
  const D4 d4;
#if HWY_TARGET == HWY_AVX3
  const hn::FixedTag<float, 8> d8;
  return hn::Combine(
      DF(), hn::Combine(d8, hn::LoadU(d4, base + offset[12]), hn::LoadU(d4, base + offset[8])),
      hn::Combine(d8, hn::LoadU(d4, base + offset[4]), hn::LoadU(d4, base + offset[0])));
#elif HWY_TARGET == HWY_AVX2
  return hn::Combine(DF(), hn::LoadU(d4, base + offset[4]), hn::LoadU(d4, base + offset[0]));
#else
  return hn::LoadU(d4, base + offset[0]);
#endif
}

// The normals and depths of the records at base + offset[lane]: loads of 16 bytes and a 4x4 transpose.
HWY_INLINE V gather(const float* base, const std::uint32_t* offset, V3& n) {
  const DF d;
  const V a0 = quads(base, offset), a1 = quads(base, offset + 1), a2 = quads(base, offset + 2),
          a3 = quads(base, offset + 3);
  const V t0 = hn::InterleaveLower(d, a0, a2), t1 = hn::InterleaveLower(d, a1, a3);
  const V t2 = hn::InterleaveUpper(d, a0, a2), t3 = hn::InterleaveUpper(d, a1, a3);
  n = {hn::InterleaveLower(d, t0, t1), hn::InterleaveUpper(d, t0, t1),
       hn::InterleaveLower(d, t2, t3)};
  return hn::InterleaveUpper(d, t2, t3);
}

// The sums of one row, of the lanes of one vector.
template <bool kWithCross>
struct RowSums {
  V sum[kSums];
  V cross[kWithCross ? kCross : 1];
  int inliers = 0, met = 0, live = 0;
};

struct Rows {
  const float *z, *nx, *ny, *nz;
  float y;
};

template <bool kWithCross>
HWY_INLINE void add_pixels(const RowsJob& job, const Rows& row, int u, RowSums<kWithCross>& out) {
  const DF df;
  const V z = load(row.z + u);
  const M has_depth = hn::Gt(z, zero());
  out.live += count(has_depth);
  const V3 p{mul(load(job.x_factor + u), z), mul(set(row.y), z), z};

  // Project into the camera that cast the model, nearest pixel.
  const V3 q{add(row3(job.R_F, p), set(job.t_F[0])), add(row3(job.R_F + 3, p), set(job.t_F[1])),
             add(row3(job.R_F + 6, p), set(job.t_F[2]))};
  M ok = hn::And(has_depth, hn::Gt(q.z, set(0.05F)));
  const V inv_z = hn::Div(set(1.0F), hn::IfThenElse(ok, q.z, set(1.0F)));
  const V pu = add(mul(mul(set(job.fx), q.x), inv_z), set(job.cx + 0.5F));
  const V pv = add(mul(mul(set(job.fy), q.y), inv_z), set(job.cy + 0.5F));
  ok = hn::And(
      ok, hn::And(hn::And(hn::Ge(pu, zero()), hn::Ge(pv, zero())),
                  hn::And(hn::Lt(pu, set(job.model_width)), hn::Lt(pv, set(job.model_height)))));
  const V iu = hn::Floor(keep(ok, pu)), iv = hn::Floor(keep(ok, pv));
  // Exact: below 2^24.
  const hn::RebindToUnsigned<DF> du;
  HWY_ALIGN std::uint32_t offset[kLanes];
  const auto pixel = truncated(add(mul(iv, set(job.model_width)), iu));
  hn::Store(hn::BitCast(du, hn::ShiftLeft<2>(pixel)), du, offset);
  // The compiler would rather take the lanes out of the vector one by one than load them.
  __asm__ volatile("" ::: "memory");
  V3 n;
  const V depth = gather(job.model, offset, n);
  const V3 m{mul(mul(sub(iu, set(job.cx)), set(job.inv_fx)), depth),
             mul(mul(sub(iv, set(job.cy)), set(job.inv_fy)), depth), depth};
  ok = hn::And(ok, hn::Gt(dot(n, n), set(0.5F)));  // a model surface, and not NaN
  out.met += count(ok);

  const V3 d{sub(q.x, m.x), sub(q.y, m.y), sub(q.z, m.z)};
  const V3 live{load(row.nx + u), load(row.ny + u), load(row.nz + u)};
  // Adding 0 makes -0 into +0, as the reference does.
  const V3 l{add(row3(job.R_F, live), zero()), add(row3(job.R_F + 3, live), zero()),
             add(row3(job.R_F + 6, live), zero())};
  ok = hn::And(ok,
               hn::And(hn::Lt(dot(d, d), set(job.gate_d2)), hn::Gt(dot(l, n), set(job.gate_cos))));
  out.inliers += count(ok);
  if (hn::AllFalse(df, ok)) return;

  const V r = keep(ok, dot(n, d));
  const V beyond = hn::Max(sub(z, set(job.noise.from_m)), zero());
  const V sigma = add(set(job.noise.least_m), mul(mul(set(job.noise.per_m2), beyond), beyond));
  const V share = hn::Div(set(job.noise.least_m), sigma);
  const V w = keep(ok, mul(share, share));
  const V3 a{sub(q.x, set(job.centre[0])), sub(q.y, set(job.centre[1])),
             sub(q.z, set(job.centre[2]))};
  V J[6];
  fill_row(ok, n, a, J);
  int s = 0;
  for (int i = 0; i < 6; ++i) {
    const V wJ = mul(w, J[i]);
    for (int j = i; j < 6; ++j, ++s) out.sum[s] = add(out.sum[s], mul(wJ, J[j]));
    out.sum[21 + i] = add(out.sum[21 + i], mul(wJ, r));
  }
  out.sum[27] = add(out.sum[27], mul(mul(w, r), r));
  out.sum[28] = add(out.sum[28], w);
  if constexpr (kWithCross) {
    V L[6];
    fill_row(ok, l, a, L);
    const V half = mul(set(0.5F), w);
    s = 0;
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j, ++s) {
        out.cross[s] = add(out.cross[s], mul(half, add(mul(L[i], J[j]), mul(J[i], L[j]))));
      }
    }
  }
}

// Adds a vector of floats to as many doubles.
HWY_INLINE void add_to(double* lanes, V v) {
  const DH dh;
  const DD dd;
  const auto half = hn::Lanes(dh);
  hn::Store(hn::Add(hn::Load(dd, lanes), hn::PromoteTo(dd, hn::LowerHalf(dh, v))), dd, lanes);
  hn::Store(hn::Add(hn::Load(dd, lanes + half), hn::PromoteTo(dd, hn::UpperHalf(dh, v))), dd,
            lanes + half);
}

template <bool kWithCross>
HWY_INLINE void accumulate_rows(const RowsJob& job, LaneSums& out) {
  for (int v = 0; v < job.rows; ++v) {
    const std::ptrdiff_t at = v * job.stride;
    const Rows row{job.z + at, job.nx + at, job.ny + at, job.nz + at, job.y_factor[v]};
    // Vectors narrower than the 16 lanes go over the row several times, each time for lanes of their own.
    for (int first = 0; first < kLanes; first += kWidth) {
      RowSums<kWithCross> sums;
      for (V& s : sums.sum) s = zero();
      for (V& s : sums.cross) s = zero();
      for (int u = first; u < job.width; u += kLanes) add_pixels(job, row, u, sums);
      for (int i = 0; i < kSums; ++i) add_to(out.sums[i] + first, sums.sum[i]);
      if constexpr (kWithCross) {
        for (int i = 0; i < kCross; ++i) add_to(out.cross[i] + first, sums.cross[i]);
      }
      out.inliers += sums.inliers, out.met += sums.met, out.live += sums.live;
    }
  }
}

void accumulate_job(const RowsJob& job, bool cross, LaneSums& out) {
  if (cross)
    accumulate_rows<true>(job, out);
  else
    accumulate_rows<false>(job, out);
}

void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                   int radius, const EdgeRule& rule, float* out) {
  const DF df;
  for (int u = 0; u < width; u += kWidth) {
    const V c = load(in + u);
    const V edge =
        add(add(set(rule.base), mul(set(rule.per_m), c)), mul(mul(set(rule.per_m2), c), c));
    const V inv = hn::Div(set(1.0F), mul(edge, edge));
    V sum = zero(), total = set(*weight);
    const float* w = weight + 1;
    for (int dv = 0; dv <= radius; ++dv) {
      const float* after = in + dv * stride + u;
      const float* before = in - dv * stride + u;
      for (int du = dv == 0 ? 1 : -radius; du <= radius; ++du, ++w) {
        const V za = load(after + du), zb = load(before - du);
        const V a = sub(za, c), b = sub(zb, c);
        const V a2 = mul(a, a), b2 = mul(b, b);
        const V k = sub(set(1.0F), mul(hn::IfThenElse(hn::Lt(a2, b2), b2, a2), inv));
        const M near = hn::And(hn::Gt(k, zero()), hn::And(hn::Gt(za, zero()), hn::Gt(zb, zero())));
        const V share = keep(near, mul(mul(k, k), set(*w)));
        sum = add(sum, mul(share, add(a, b)));  // around the centre: no digits lost
        total = add(total, add(share, share));
      }
    }
    hn::StoreU(keep(hn::Gt(c, zero()), add(c, hn::Div(sum, total))), df, out + u);
  }
}

void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                const float* y_factor, const EdgeRule& rule, float* out_x, float* out_y,
                float* out_z) {
  const DF df;
  const auto within = [](V a, V limit) { return hn::Lt(hn::Abs(a), limit); };
  for (int u = 0; u < width; u += kWidth) {
    const V c = load(z + u), l = load(z + u - 1), r = load(z + u + 1);
    const V t = load(z + u - stride), b = load(z + u + stride);
    const V noise = add(set(rule.base), mul(mul(set(rule.per_m2), c), c));
    const V step = add(noise, mul(set(rule.per_m), c));
    M ok = hn::Gt(c, zero());
    for (const V side : {l, r, t, b})
      ok = hn::And(ok, hn::And(hn::Gt(side, zero()), within(sub(side, c), step)));
    ok = hn::And(ok, hn::And(within(sub(sub(add(l, r), c), c), noise),
                             within(sub(sub(add(t, b), c), c), noise)));
    const V xl = load(x_factor + u - 1), xc = load(x_factor + u), xr = load(x_factor + u + 1);
    const V az = sub(r, l), bz = sub(b, t);
    const V ax = sub(mul(xr, r), mul(xl, l)), ay = mul(set(y_factor[0]), az);
    const V bx = mul(xc, bz), by = sub(mul(set(y_factor[1]), b), mul(set(y_factor[-1]), t));
    const V nx = sub(mul(by, az), mul(bz, ay)), ny = sub(mul(bz, ax), mul(bx, az)),
            nz = sub(mul(bx, ay), mul(by, ax));
    const V l2 = add(add(mul(nx, nx), mul(ny, ny)), mul(nz, nz));
    ok = hn::And(ok, hn::Gt(l2, zero()));
    const V inv = hn::Div(set(1.0F), hn::Sqrt(hn::IfThenElse(ok, l2, set(1.0F))));
    hn::StoreU(keep(ok, mul(nx, inv)), df, out_x + u);
    hn::StoreU(keep(ok, mul(ny, inv)), df, out_y + u);
    hn::StoreU(keep(ok, mul(nz, inv)), df, out_z + u);
  }
}

void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
  const DF df;
  const DI di;
  const hn::Rebind<std::uint16_t, DF> dm;
  int u = 0;
  for (; u + kWidth <= width; u += kWidth) {
    const V z = hn::Div(hn::ConvertTo(df, hn::PromoteTo(di, hn::LoadU(dm, mm + u))), set(1000.0F));
    hn::StoreU(keep(hn::And(hn::Ge(z, set(min_m)), hn::Le(z, set(max_m))), z), df, out + u);
  }
  kScalarKernels.to_metres_row(mm + u, width - u, min_m, max_m, out + u);
}

void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
  const DF df;
  int u = 0;
  for (; u + kWidth <= width; u += kWidth) {
    // Columns 2u - 1, 2u, 2u + 1 of the rows above, at and below.
    V left[3], mid[3], right[3], spare;
    for (int r = 0; r < 3; ++r) {
      const float* p = in + (r - 1) * stride + 2 * u;
      hn::LoadInterleaved2(df, p, mid[r], right[r]);
      hn::LoadInterleaved2(df, p - 1, left[r], spare);
    }
    const V c = mid[1];
    const V noise = add(set(rule.base), mul(mul(set(rule.per_m2), c), c));
    const V step = add(noise, mul(set(rule.per_m), c));
    V sum = zero(), n = set(1.0F);
    const V pair[4][2] = {
        {right[1], left[1]}, {mid[2], mid[0]}, {right[2], left[0]}, {left[2], right[0]}};
    for (const auto& p : pair) {
      const V a = sub(p[0], c), b = sub(p[1], c), both = add(a, b);
      const M same = hn::And(hn::And(hn::And(hn::Lt(hn::Abs(a), step), hn::Lt(hn::Abs(b), step)),
                                     hn::Lt(hn::Abs(both), noise)),
                             hn::And(hn::Gt(p[0], zero()), hn::Gt(p[1], zero())));
      sum = add(sum, keep(same, both));
      n = add(n, keep(same, set(2.0F)));
    }
    hn::StoreU(keep(hn::Gt(c, zero()), add(c, hn::Div(sum, n))), df, out + u);
  }
  kScalarKernels.half_row(in + 2 * u, stride, width - u, rule, out + u);
}

#endif  // HWY_TARGET
}  // namespace HWY_NAMESPACE
}  // namespace perception::icp
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception::icp {
namespace {

HWY_EXPORT(accumulate_job);
HWY_EXPORT(bilateral_row);
HWY_EXPORT(normal_row);
HWY_EXPORT(to_metres_row);
HWY_EXPORT(half_row);

const Kernels kVectorKernels{
    [](const RowsJob& job, bool cross, LaneSums& out) {
      HWY_DYNAMIC_DISPATCH(accumulate_job)(job, cross, out);
    },
    [](const float* in, std::ptrdiff_t stride, int width, const float* weight, int radius,
       const EdgeRule& rule, float* out) {
      HWY_DYNAMIC_DISPATCH(bilateral_row)(in, stride, width, weight, radius, rule, out);
    },
    [](const float* z, std::ptrdiff_t stride, int width, const float* x, const float* y,
       const EdgeRule& rule, float* nx, float* ny, float* nz) {
      HWY_DYNAMIC_DISPATCH(normal_row)(z, stride, width, x, y, rule, nx, ny, nz);
    },
    [](const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
      HWY_DYNAMIC_DISPATCH(to_metres_row)(mm, width, min_m, max_m, out);
    },
    [](const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
      HWY_DYNAMIC_DISPATCH(half_row)(in, stride, width, rule, out);
    }};

}  // namespace

const Kernels& kernels() noexcept {
  return simd::chosen() == simd::Isa::kScalar ? kScalarKernels : kVectorKernels;
}

}  // namespace perception::icp
#endif
