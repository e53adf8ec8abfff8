// The sums of ICP with vectors of pixels, in three steps over a stretch of a row: project the
// pixels; compute their gates and Jacobians with the model's points there; add these up, as many
// sums at a time as there are registers. In a single loop the sums would live in memory, and each
// vector would wait for the one before.
#include "perception/icp/kernels.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/icp/accumulate.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/icp/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception::icp {
namespace HWY_NAMESPACE {

// Without vectors of 16 bytes at least (a processor older than SSE4): the reference itself.
#if HWY_TARGET == HWY_SCALAR
void accumulate_job(const RowsJob& job, bool cross, LaneSums& out) {
  kScalarKernels.accumulate(job, cross, out);
}
void accumulate_squares_job(const RowsJob& job, float factor, SquareSums& out) {
  kScalarKernels.accumulate_squares(job, factor, out);
}
#else

struct V3 {
  V x, y, z;
};
HWY_INLINE V dot(V3 a, V3 b) { return add(add(mul(a.x, b.x), mul(a.y, b.y)), mul(a.z, b.z)); }
HWY_INLINE V row3(const float* R, V3 p) {
  return add(add(mul(set(R[0]), p.x), mul(set(R[1]), p.y)), mul(set(R[2]), p.z));
}
HWY_INLINE V3 cross_product(V3 a, V3 b) {
  return {sub(mul(a.y, b.z), mul(a.z, b.y)), sub(mul(a.z, b.x), mul(a.x, b.z)),
          sub(mul(a.x, b.y), mul(a.y, b.x))};
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

// The normals and depths of the records at base + offset[lane]: loads of 16 bytes and a 4x4
// transpose.
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

// Projections of the pixels of a row, then their terms. Vectors without any term are left out.
// Stays in the nearest cache.
constexpr int kStretch = 256;  // pixels
template <int kCount>
using Columns = float[kCount][kStretch];
struct Projected {
  alignas(64) Columns<3> q;  // in F; z = 0: not in the model's image
  alignas(64) Columns<2> m;  // the model's pixel, as its point at 1 m
  alignas(64) std::uint32_t offset[kStretch];
  int u[kStretch / kWidth];
  int vectors = 0;
};
struct Pairs {
  alignas(64) Columns<6> J;
  alignas(64) Columns<6> L;  // as J, of the live normal; with the cross moment only
  alignas(64) float r[kStretch], w[kStretch];
  int size = 0;
};

struct Rows {
  const float *z, *nx, *ny, *nz;
  float y;
};

struct Counts {
  int inliers = 0, met = 0, live = 0, on_surface = 0;
};

HWY_INLINE void put(V v, float (&column)[kStretch], int at) { hn::Store(v, DF(), column + at); }
HWY_INLINE V get(const float (&column)[kStretch], int at) { return hn::Load(DF(), column + at); }

// Projects into the camera that cast the model, nearest pixel. In a loop of its own, so that the
// long chains of operations of
// several vectors overlap.
HWY_INLINE void project(const RowsJob& job, const Rows& row, int u, Counts& counts,
                        Projected& out) {
  const DF df;
  const V z = load(row.z + u);
  const M has_depth = hn::Gt(z, zero());
  if (hn::AllFalse(df, has_depth)) return;
  counts.live += count(has_depth);
  const V3 p{mul(load(job.x_factor + u), z), mul(set(row.y), z), z};
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
  const auto pixel = truncated(add(mul(iv, set(job.model_width)), iu));
  const DU du;
  const int at = kWidth * out.vectors;
  hn::Store(hn::BitCast(du, hn::ShiftLeft<2>(pixel)), du, out.offset + at);
  put(q.x, out.q[0], at), put(q.y, out.q[1], at), put(keep(ok, q.z), out.q[2], at);
  put(mul(sub(iu, set(job.cx)), set(job.inv_fx)), out.m[0], at);
  put(mul(sub(iv, set(job.cy)), set(job.inv_fy)), out.m[1], at);
  out.u[out.vectors++] = u;
}

HWY_INLINE void put_row(M ok, V3 n, V3 a, Columns<6>& J, int at) {
  const V3 c = cross_product(a, n);
  const V all[6] = {n.x, n.y, n.z, c.x, c.y, c.z};
  for (int i = 0; i < 6; ++i) put(keep(ok, all[i]), J[i], at);
}

// What the n-th vector of `in` gives with the model's points that it projects to.
// `kAlike`: all pixels weigh 1.
template <bool kWithCross, bool kAlike = false>
HWY_INLINE void pair_up(const RowsJob& job, const Rows& row, const Projected& in, int n_th,
                        Counts& counts, Pairs& out) {
  const DF df;
  const int from = kWidth * n_th, u = in.u[n_th];
  const V3 q{get(in.q[0], from), get(in.q[1], from), get(in.q[2], from)};
  V3 n;
  const V depth = gather(job.model, in.offset + from, n);
  M ok = hn::And(hn::Gt(q.z, zero()), hn::Gt(dot(n, n), set(0.5F)));  // a surface, and not NaN
  counts.met += count(ok);

  const V3 d{sub(q.x, mul(get(in.m[0], from), depth)), sub(q.y, mul(get(in.m[1], from), depth)),
             sub(q.z, depth)};
  const V3 live{load(row.nx + u), load(row.ny + u), load(row.nz + u)};
  const V3 l{row3(job.R_F, live), row3(job.R_F + 3, live), row3(job.R_F + 6, live)};
  ok = hn::And(ok, hn::Lt(dot(d, d), set(job.gate_d2)));
  const V r = dot(n, d);
  V sigma = zero();
  if constexpr (!kAlike) {
    const V beyond = hn::Max(sub(load(row.z + u), set(job.noise.from_m)), zero());
    sigma = add(set(job.noise.least_m), mul(mul(set(job.noise.per_m2), beyond), beyond));
  }
  if constexpr (kWithCross) {
    const V limit = add(mul(set(kOnSurfaceSigmas), sigma), set(job.map_error_m));
    counts.on_surface += count(hn::And(ok, hn::Lt(hn::Abs(r), limit)));
  }
  ok = hn::And(ok, hn::Gt(dot(l, n), set(job.gate_cos)));
  if (hn::AllFalse(df, ok)) return;
  counts.inliers += count(ok);

  const V share = kAlike ? set(1.0F) : hn::Div(set(job.noise.least_m), sigma);
  const V3 a{sub(q.x, set(job.centre[0])), sub(q.y, set(job.centre[1])),
             sub(q.z, set(job.centre[2]))};
  const int at = out.size;
  put_row(ok, n, a, out.J, at);
  if constexpr (kWithCross) put_row(ok, l, a, out.L, at);
  put(keep(ok, r), out.r, at);
  put(keep(ok, mul(share, share)), out.w, at);
  out.size = at + kWidth;
}

// The sums of one row, of the lanes of one vector.
struct RowSums {
  alignas(64) float sums[kSums][kWidth];
  alignas(64) float cross[kCross][kWidth];
};

// Rows kFirst to kLast - 1 of the upper triangle of H, and of g; with the last row r2 and weight
// too.
template <int kFirst, int kLast>
HWY_INLINE void add_rows(const Pairs& s, RowSums& out) {
  const DF df;
  constexpr int kBegin = kFirst * 6 - kFirst * (kFirst - 1) / 2;
  constexpr int kEntries = kLast * 6 - kLast * (kLast - 1) / 2 - kBegin;
  V H[kEntries], g[kLast - kFirst], r2 = zero(), weight = zero();
#pragma GCC unroll 32
  for (int i = 0; i < kEntries; ++i) H[i] = hn::Load(df, out.sums[kBegin + i]);
#pragma GCC unroll 8
  for (int i = kFirst; i < kLast; ++i) g[i - kFirst] = hn::Load(df, out.sums[21 + i]);
  if constexpr (kLast == 6) r2 = hn::Load(df, out.sums[27]), weight = hn::Load(df, out.sums[28]);
  for (int at = 0; at < s.size; at += kWidth) {
    const V w = get(s.w, at), r = get(s.r, at);
    int k = 0;
#pragma GCC unroll 8
    for (int i = kFirst; i < kLast; ++i) {
      const V wJ = mul(w, get(s.J[i], at));
#pragma GCC unroll 8
      for (int j = i; j < 6; ++j, ++k) H[k] = add(H[k], mul(wJ, get(s.J[j], at)));
      g[i - kFirst] = add(g[i - kFirst], mul(wJ, r));
    }
    if constexpr (kLast == 6) r2 = add(r2, mul(mul(w, r), r)), weight = add(weight, w);
  }
#pragma GCC unroll 32
  for (int i = 0; i < kEntries; ++i) hn::Store(H[i], df, out.sums[kBegin + i]);
#pragma GCC unroll 8
  for (int i = kFirst; i < kLast; ++i) hn::Store(g[i - kFirst], df, out.sums[21 + i]);
  if constexpr (kLast == 6) hn::Store(r2, df, out.sums[27]), hn::Store(weight, df, out.sums[28]);
}

// Rows of the upper triangle of the cross moment.
template <int kFirst, int kLast>
HWY_INLINE void add_cross_rows(const Pairs& s, RowSums& out) {
  const DF df;
  constexpr int kBegin = kFirst * 6 - kFirst * (kFirst - 1) / 2;
  constexpr int kEntries = kLast * 6 - kLast * (kLast - 1) / 2 - kBegin;
  V H[kEntries];
#pragma GCC unroll 32
  for (int i = 0; i < kEntries; ++i) H[i] = hn::Load(df, out.cross[kBegin + i]);
  for (int at = 0; at < s.size; at += kWidth) {
    const V half = mul(set(0.5F), get(s.w, at));
    int k = 0;
#pragma GCC unroll 8
    for (int i = kFirst; i < kLast; ++i) {
      const V L = get(s.L[i], at), J = get(s.J[i], at);
#pragma GCC unroll 8
      for (int j = i; j < 6; ++j, ++k) {
        const V both = add(mul(L, get(s.J[j], at)), mul(J, get(s.L[j], at)));
        H[k] = add(H[k], mul(half, both));
      }
    }
  }
#pragma GCC unroll 32
  for (int i = 0; i < kEntries; ++i) hn::Store(H[i], df, out.cross[kBegin + i]);
}

template <bool kWithCross>
HWY_INLINE void add_pairs(const Pairs& s, RowSums& out) {
  if constexpr (kWidth == 16) {  // and 32 registers
    add_rows<0, 3>(s, out);
    add_rows<3, 6>(s, out);
    if constexpr (kWithCross) add_cross_rows<0, 6>(s, out);
  } else {
    add_rows<0, 2>(s, out);
    add_rows<2, 4>(s, out);
    add_rows<4, 6>(s, out);
    if constexpr (kWithCross) {
      add_cross_rows<0, 2>(s, out);
      add_cross_rows<2, 6>(s, out);
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
  const DF df;
  Projected projected;
  Pairs pairs;
  RowSums sums;
  for (int v = 0; v < job.rows; ++v) {
    const std::ptrdiff_t at = v * job.stride;
    const Rows row{job.z + at, job.nx + at, job.ny + at, job.nz + at, job.y_factor[v]};
    Counts counts;
    // Vectors narrower than the 16 lanes go over the row several times, each time for lanes of
    // their own.
    for (int first = 0; first < kLanes; first += kWidth) {
      for (auto& s : sums.sums) hn::Store(zero(), df, s);
      for (auto& s : sums.cross) hn::Store(zero(), df, s);
      for (int u = first; u < job.width;) {
        projected.vectors = pairs.size = 0;
        for (; u < job.width && projected.vectors < kStretch / kWidth; u += kLanes)
          project(job, row, u, counts, projected);
        for (int n = 0; n < projected.vectors; ++n)
          pair_up<kWithCross>(job, row, projected, n, counts, pairs);
        add_pairs<kWithCross>(pairs, sums);
      }
      for (int i = 0; i < kSums; ++i) add_to(out.sums[i] + first, hn::Load(df, sums.sums[i]));
      if constexpr (kWithCross)
        for (int i = 0; i < kCross; ++i) add_to(out.cross[i] + first, hn::Load(df, sums.cross[i]));
    }
    out.inliers += counts.inliers, out.met += counts.met, out.live += counts.live;
    out.on_surface += counts.on_surface;
  }
}

void accumulate_job(const RowsJob& job, bool cross, LaneSums& out) {
  if (cross)
    accumulate_rows<true>(job, out);
  else
    accumulate_rows<false>(job, out);
}

// ---------------------------------------------------------------- squares of 8 x 8 pixels

// What four neighbouring columns sum up to; kSums and up to a multiple of four.
struct FourColumns {
  alignas(64) float sums[kLanes / 4][(kSums + 3) / 4 * 4];
};

// Of sum n: which entries of J it multiplies. 6: the residual; 7: 1.
struct Factors {
  int i[32] = {}, j[32] = {};
  constexpr Factors() {
    int n = 0;
    for (int a = 0; a < 6; ++a)
      for (int b = a; b < 6; ++b, ++n) i[n] = a, j[n] = b;
    for (int a = 0; a < 6; ++a, ++n) i[n] = a, j[n] = 6;
    i[27] = j[27] = 6;
    for (n = 28; n < 32; ++n) i[n] = j[n] = 7;
  }
};
constexpr Factors kFactors;

// Each of four vectors summed up within its blocks of four lanes, (0 + 1) + (2 + 3): lane n of a
// block is vector n's.
HWY_INLINE V sum_blocks(V a, V b, V c, V e) {
  const DF d;
  const V t0 = hn::InterleaveLower(d, a, c), t1 = hn::InterleaveLower(d, b, e);
  const V t2 = hn::InterleaveUpper(d, a, c), t3 = hn::InterleaveUpper(d, b, e);
  return add(add(hn::InterleaveLower(d, t0, t1), hn::InterleaveUpper(d, t0, t1)),
             add(hn::InterleaveLower(d, t2, t3), hn::InterleaveUpper(d, t2, t3)));
}

HWY_INLINE void put_blocks(V v, int u, int first, FourColumns& out) {
  alignas(64) float lanes[kWidth];
  hn::Store(v, DF(), lanes);
  const D4 d4;
  for (int b = 0; b < kWidth; b += 4)
    hn::Store(hn::Load(d4, lanes + b), d4, out.sums[(u + b) / 4] + first);
}

// Sums kFirst to kFirst + kCount - 1, rows in rising order.
template <bool kAlike, int kFirst, int kCount>
HWY_INLINE void sum_up(const Pairs& s, int u, FourColumns& out) {
  V sum[kCount];
#pragma GCC unroll 16
  for (int n = 0; n < kCount; ++n) sum[n] = zero();
  for (int at = 0; at < s.size; at += kWidth) {
#pragma GCC unroll 16
    for (int n = 0; n < kCount; ++n) {
      const int i = kFactors.i[kFirst + n], j = kFactors.j[kFirst + n];
      if (i == 7) {
        sum[n] = add(sum[n], get(s.w, at));
        continue;
      }
      V weighted = i == 6 ? get(s.r, at) : get(s.J[i], at);
      if constexpr (!kAlike) weighted = mul(get(s.w, at), weighted);
      sum[n] = add(sum[n], mul(weighted, j == 6 ? get(s.r, at) : get(s.J[j], at)));
    }
  }
#pragma GCC unroll 4
  for (int n = 0; n < kCount; n += 4)
    put_blocks(sum_blocks(sum[n], sum[n + 1], sum[n + 2], sum[n + 3]), u, kFirst + n, out);
}

template <bool kAlike>
HWY_INLINE void accumulate_squares_of(const RowsJob& job, float factor, SquareSums& out) {
  static_assert(kStretch >= kSquare * kWidth);
  Projected projected;
  Pairs pairs;
  FourColumns columns;
  Counts counts;
  int row_of[kSquare + 1];
  const auto row = [&](int v) {
    const std::ptrdiff_t at = v * job.stride;
    return Rows{job.z + at, job.nx + at, job.ny + at, job.nz + at, job.y_factor[v]};
  };
  const int width = job.width > kSquare ? kLanes : kSquare;
  for (int u = 0; u < width; u += kWidth) {
    projected.vectors = pairs.size = 0;
    for (int v = 0; v < job.rows; ++v) {
      row_of[projected.vectors] = v;
      project(job, row(v), u, counts, projected);
    }
    for (int n = 0; n < projected.vectors; ++n)
      pair_up<false, kAlike>(job, row(row_of[n]), projected, n, counts, pairs);
    sum_up<kAlike, 0, 12>(pairs, u, columns);
    sum_up<kAlike, 12, 12>(pairs, u, columns);
    sum_up<kAlike, 24, 8>(pairs, u, columns);
  }
  for (int square = 0; square * kSquare < width; ++square) {
    const auto &left = columns.sums[2 * square], &right = columns.sums[2 * square + 1];
    for (int i = 0; i < kSums; ++i) out[square][i] = factor * (left[i] + right[i]);
  }
}

void accumulate_squares_job(const RowsJob& job, float factor, SquareSums& out) {
  if (job.noise.per_m2 == 0)
    accumulate_squares_of<true>(job, factor, out);
  else
    accumulate_squares_of<false>(job, factor, out);
}

#endif  // HWY_TARGET
}  // namespace HWY_NAMESPACE
}  // namespace perception::icp
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception::icp {
namespace {
HWY_EXPORT(accumulate_job);
HWY_EXPORT(accumulate_squares_job);
}  // namespace

void accumulate_vectors(const RowsJob& job, bool cross, LaneSums& out) {
  HWY_DYNAMIC_DISPATCH(accumulate_job)(job, cross, out);
}

void accumulate_squares_vectors(const RowsJob& job, float factor, SquareSums& out) {
  HWY_DYNAMIC_DISPATCH(accumulate_squares_job)(job, factor, out);
}

}  // namespace perception::icp
#endif
