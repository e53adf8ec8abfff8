#include "perception/raycast/hint_kernel.hpp"

#include <cstring>

#include "perception/simd/targets.hpp"
#include "perception/tsdf/chunk_directory.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/raycast/hint_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

struct Corners {
  VF v[8];  // raw units; corner bit 2 = x+1, bit 1 = y+1, bit 0 = z+1
  MF known;
};

// Two neighbouring words at p[lane] + at of every lane, as the low and the high word of 64 bits; sorted
// into vectors of low and of high words.
HWY_INLINE void load_pairs(const std::int32_t* const* p, std::ptrdiff_t at, VI& low, VI& high) {
#if HWY_TARGET == HWY_SCALAR
  low = hn::Set(DI(), p[0][at]);
  high = hn::Set(DI(), p[0][at + 1]);
#else
  const DI di;
  const hn::FixedTag<std::int32_t, 2> d2;
  const hn::FixedTag<std::int32_t, 4> d4;
  const auto four = [&](std::size_t n) {
    return hn::Combine(d4, hn::LoadU(d2, p[n + 1] + at), hn::LoadU(d2, p[n] + at));
  };
#if HWY_TARGET == HWY_AVX3
  const hn::FixedTag<std::int32_t, 8> d8;
  const auto eight = [&](std::size_t n) { return hn::Combine(d8, four(n + 2), four(n)); };
  const VI a = hn::Combine(di, eight(4), eight(0)), b = hn::Combine(di, eight(12), eight(8));
#elif HWY_TARGET == HWY_AVX2
  const VI a = hn::Combine(di, four(2), four(0)), b = hn::Combine(di, four(6), four(4));
#else
  const VI a = four(0), b = four(2);
#endif
  low = hn::ConcatEven(di, b, a);
  high = hn::ConcatOdd(di, b, a);
#endif
}

// Reads the nodes of up to 16 cells. Which words those are is worked out a lane at a time: two corners that
// differ in z lie side by side and come in one load, which no gather instruction does faster.
HWY_INLINE Corners read_cells(const HintJob& job, const VI (&node)[3], MF active) {
  const DI di;
  const DU du;
  const DF df;
  const VI seven = hn::Set(di, 7), zero = hn::Zero(di);
  VI chunk[3], slot[3], cell[3];
  for (int a = 0; a < 3; ++a) {
    chunk[a] = hn::Sub(hn::ShiftRight<6>(node[a]), hn::Set(di, job.corner[a]));
    slot[a] = hn::And(hn::ShiftRight<3>(node[a]), seven);
    cell[a] = hn::And(node[a], seven);
  }
  const VI outside = hn::AndNot(hn::Set(di, ChunkDirectory::kEdge - 1),
                                hn::Or(hn::Or(chunk[0], chunk[1]), chunk[2]));
  const MF inside = hn::And(active, hn::RebindMask(df, hn::Eq(outside, zero)));
  const auto join5 = [](const VI(&v)[3]) {
    return hn::Or(hn::ShiftLeft<10>(v[0]), hn::Or(hn::ShiftLeft<5>(v[1]), v[2]));
  };
  const auto join3 = [](const VI(&v)[3]) {
    return hn::Or(hn::ShiftLeft<6>(v[0]), hn::Or(hn::ShiftLeft<3>(v[1]), v[2]));
  };
  const auto safe = [&](VI v) { return hn::IfThenElseZero(hn::RebindMask(di, inside), v); };
  // Bit n: the cell reaches into the next block along that axis.
  VI across = zero;
  for (int a = 0; a < 3; ++a)
    across = hn::Or(across, hn::IfThenElseZero(hn::Eq(cell[a], seven), hn::Set(di, 4 >> a)));
  HWY_ALIGN std::uint32_t entry_[16];
  HWY_ALIGN std::uint32_t slot_[16];
  HWY_ALIGN std::uint32_t cell_[16];
  HWY_ALIGN std::uint32_t across_[16];
  hn::Store(hn::BitCast(du, safe(join5(chunk))), du, entry_);
  hn::Store(hn::BitCast(du, safe(join3(slot))), du, slot_);
  hn::Store(hn::BitCast(du, safe(join3(cell))), du, cell_);
  hn::Store(hn::BitCast(du, safe(across)), du, across_);
  // The compiler would rather take the lanes out of the vectors one by one than load them.
  __asm__ volatile("" ::: "memory");

  const std::int32_t* p[16];
  HWY_ALIGN std::int32_t patched[16][80];  // as in a block: words 0, 1, 8, 9, 64, 65, 72, 73
  for (const std::int32_t*& lane : p)
    lane = job.words + (static_cast<std::size_t>(job.empty_block) << 9U);
  for (unsigned lanes = bits_of(inside); lanes != 0; lanes &= lanes - 1) {
    const auto n = static_cast<std::size_t>(__builtin_ctz(lanes));
    const std::int32_t found =
        job.tables[static_cast<std::uint32_t>(job.directory[entry_[n]]) + slot_[n]];
    const auto b = static_cast<std::size_t>(found < 0 ? job.empty_block : found);
    p[n] = job.words + (b << 9U) + cell_[n];
    const std::uint32_t m = across_[n];
    if (m == 0) continue;
    const std::uint32_t c = cell_[n];
    const std::uint32_t x[2] = {c & 0x1c0U, (c + 64U) & 0x1c0U},
                        y[2] = {c & 0x38U, (c + 8U) & 0x38U}, z[2] = {c & 7U, (c + 1U) & 7U};
    const auto corner = [&](std::uint32_t k) {
      const auto block = static_cast<std::size_t>(job.ahead[8 * b + (k & m)]);
      return job.words + ((block << 9U) + (x[k >> 2U] | y[(k >> 1U) & 1U] | z[k & 1U]));
    };
    for (std::uint32_t k = 0; k < 8; k += 2) {
      std::int32_t* const pair = &patched[n][(k >> 2U) * 64 + ((k >> 1U) & 1U) * 8];
      if ((m & 1U) == 0) {  // corners that differ in z lie side by side
        std::memcpy(pair, corner(k), 2 * sizeof *pair);
      } else {
        pair[0] = *corner(k);
        pair[1] = *corner(k + 1);
      }
    }
    p[n] = patched[n];
  }
  __asm__ volatile("" ::: "memory");

  Corners out;
  hn::Vec<DU> least = hn::Set(du, 0xffffffffU);
  constexpr std::ptrdiff_t kAt[4] = {0, 8, 64, 72};
  for (int n = 0; n < 4; ++n) {
    VI low, high;
    load_pairs(p, kAt[n], low, high);
    least = hn::Min(least, hn::Min(hn::BitCast(du, low), hn::BitCast(du, high)));
    out.v[2 * n] = hn::ConvertTo(df, hn::ShiftRight<16>(hn::ShiftLeft<16>(low)));
    out.v[2 * n + 1] = hn::ConvertTo(df, hn::ShiftRight<16>(hn::ShiftLeft<16>(high)));
  }
  // A word's weight is its high half: the least weight is the least word's.
  const VI weight = hn::BitCast(di, hn::ShiftRight<16>(least));
  const auto need = static_cast<std::int32_t>(job.least_word >> 16U) - 1;
  out.known = hn::And(inside, hn::RebindMask(df, hn::Gt(weight, hn::Set(di, need))));
  return out;
}

struct Value {
  VF f, g[3];
  MF known;
};

HWY_INLINE Value value_at(const HintJob& job, const VF (&d)[3], VF t, MF active) {
  const DF df;
  const DI di;
  VI node[3];
  VF f[3];
  for (int a = 0; a < 3; ++a) {
    const VF p = hn::Add(hn::Set(df, job.origin[a]), hn::Mul(t, d[a]));
    const VF whole = hn::Floor(p);
    f[a] = hn::Sub(p, whole);
    node[a] = hn::Add(truncated(whole), hn::Set(di, job.base[a]));
  }
  const Corners c = read_cells(job, node, active);
  // As MapReader::Cell: dx at the four (y, z), then along y and z.
  VF dx[4], x[4];
  for (int n = 0; n < 4; ++n) {
    dx[n] = hn::Sub(c.v[n + 4], c.v[n]);
    x[n] = hn::Add(c.v[n], hn::Mul(f[0], dx[n]));
  }
  Value out;
  const VF v0 = hn::Add(x[0], hn::Mul(f[1], hn::Sub(x[2], x[0])));
  const VF v1 = hn::Add(x[1], hn::Mul(f[1], hn::Sub(x[3], x[1])));
  out.f = hn::Add(v0, hn::Mul(f[2], hn::Sub(v1, v0)));
  const VF dx0 = hn::Add(dx[0], hn::Mul(f[2], hn::Sub(dx[1], dx[0])));
  const VF dx1 = hn::Add(dx[2], hn::Mul(f[2], hn::Sub(dx[3], dx[2])));
  out.g[0] = hn::Add(dx0, hn::Mul(f[1], hn::Sub(dx1, dx0)));
  const VF y0 = hn::Add(x[0], hn::Mul(f[2], hn::Sub(x[1], x[0])));
  const VF y1 = hn::Add(x[2], hn::Mul(f[2], hn::Sub(x[3], x[2])));
  out.g[1] = hn::Sub(y1, y0);
  const VF z0 = hn::Sub(x[1], x[0]), z1 = hn::Sub(x[3], x[2]);
  out.g[2] = hn::Add(z0, hn::Mul(f[1], hn::Sub(z1, z0)));
  out.known = c.known;
  return out;
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

HintCount cast_hints_job(const HintJob& job, const HintSpan& span) {
  const DF df;
  const DI di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const VF half = hn::Set(df, 0.5F), one = hn::Set(df, 1.0F),
           close_to = hn::Set(df, HintJob::kClose);
  const VF y = hn::Set(df, span.y);
  HintCount count;
  for (int u = 0; u < span.count; u += lanes) {
    const VF hint = hn::LoadU(df, span.hint + u), x = hn::LoadU(df, span.x + u);
    VF d[3];
    for (int a = 0; a < 3; ++a) {
      d[a] = hn::Add(
          hn::Add(hn::Mul(x, hn::Set(df, job.axes[0][a])), hn::Mul(y, hn::Set(df, job.axes[1][a]))),
          hn::Set(df, job.axes[2][a]));
    }
    const VF dd = hn::Add(hn::Add(hn::Mul(d[0], d[0]), hn::Mul(d[1], d[1])), hn::Mul(d[2], d[2]));
    const VF voxel_t = hn::Div(one, hn::Sqrt(dd));
    const VF near = hn::Mul(hn::Set(df, job.reach), voxel_t);
    const VF from = hn::Sub(hint, near), to = hn::Add(hint, near);
    MF active = hn::And(hn::Gt(hint, hn::Zero(df)), hn::And(hn::Gt(from, hn::Set(df, job.first)),
                                                            hn::Lt(to, hn::Set(df, job.last))));
    const VF low = hn::Sub(from, hn::Mul(half, voxel_t)),
             high = hn::Add(to, hn::Mul(half, voxel_t));
    const VF small = hn::Mul(close_to, voxel_t);
    VF t = hn::IfThenElseZero(active, hint);
    VF hit_t = hn::Zero(df);
    VF g[3] = {hn::Zero(df), hn::Zero(df), hn::Zero(df)};
    MF done = hn::Gt(hn::Zero(df), hn::Zero(df));
    for (int n = 0; n < HintJob::kNewton && !hn::AllFalse(df, active); ++n) {
      count.steps += static_cast<std::int64_t>(hn::CountTrue(df, active));
      const Value c = value_at(job, d, t, active);
      const VF slope =
          hn::Add(hn::Add(hn::Mul(c.g[0], d[0]), hn::Mul(c.g[1], d[1])), hn::Mul(c.g[2], d[2]));
      active = hn::And(active, hn::And(c.known, hn::Lt(slope, hn::Zero(df))));
      const VF move = hn::Div(hn::Neg(c.f), hn::IfThenElse(active, slope, hn::Neg(one)));
      const VF next = hn::Add(t, move);
      active = hn::And(active, hn::And(hn::Ge(next, low), hn::Le(next, high)));
      t = hn::IfThenElse(active, next, t);
      const MF close = hn::And(active, hn::And(hn::Lt(move, small), hn::Gt(move, hn::Neg(small))));
      hit_t = hn::IfThenElse(close, t, hit_t);
      for (int a = 0; a < 3; ++a) g[a] = hn::IfThenElse(close, c.g[a], g[a]);
      done = hn::Or(done, close);
      active = hn::AndNot(close, active);
    }
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
    const int here = span.count - u < lanes ? span.count - u : lanes;
    store_records(n, hn::IfThenElseZero(hit, hit_t), here, span.records + 4 * u);
    count.hits += static_cast<std::int32_t>(hn::CountTrue(df, hit));
    HWY_ALIGN std::int32_t settled[16];
    hn::Store(hn::IfThenElseZero(hn::RebindMask(di, done), hn::Set(di, 1)), di, settled);
    for (int i = 0; i < here; ++i) span.found[u + i] = static_cast<std::uint8_t>(settled[i]);
  }
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
