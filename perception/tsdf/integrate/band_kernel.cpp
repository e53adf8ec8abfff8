#include "perception/tsdf/integrate/band_kernel.hpp"

#include <cmath>
#include <cstdlib>

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"
#include "perception/tsdf/blocks/chunk_directory.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/tsdf/integrate/band_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

#ifndef TELETACT_BAND_ONCE
#define TELETACT_BAND_ONCE
namespace perception {
namespace {

// True if the map lacks the block at `b` (relative to base). Beyond the directory: true; then the
// map itself is asked.
inline bool missing(const BandJob& job, const std::int32_t (&b)[3]) noexcept {
  const int cx = (b[0] >> 3) - job.corner[0], cy = (b[1] >> 3) - job.corner[1],
            cz = (b[2] >> 3) - job.corner[2];
  if (((cx | cy | cz) & ~(ChunkDirectory::kEdge - 1)) != 0) return true;
  const int slot = (b[0] & 7) << 6 | (b[1] & 7) << 3 | (b[2] & 7);
  return job.tables[job.directory[(cx << 10) + (cy << 5) + cz] + slot] < 0;
}

}  // namespace
}  // namespace perception
#endif

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

// The blocks of one step of up to 16 rays.
class Emit {
 public:
  HWY_INLINE Emit(const BandJob& job, std::uint64_t* found) : job_(job), found_(found) {
    for (std::uint32_t& key : last_) key = 0x80000000U;
  }
  HWY_INLINE void operator()(int step, const VI (&b)[3], unsigned lanes) {
    const DI di;
    const DU du;
    // Relative to the camera's block a coordinate fits 11, 11 and 10 bits; a wrap would need
    // neighbouring rays a thousand blocks apart.
    const auto low = [&](VI v, std::uint32_t mask) {
      return hn::And(hn::BitCast(du, v), hn::Set(du, mask));
    };
    const VU keys = hn::Or(hn::ShiftLeft<21>(low(b[0], 0x7ffU)),
                           hn::Or(hn::ShiftLeft<10>(low(b[1], 0x7ffU)), low(b[2], 0x3ffU)));
    // Most rays meet, step by step, the blocks that the ray before them met.
    lanes &= ~bits_of(hn::RebindMask(DF(), hn::Eq(keys, hn::Set(du, last_[step]))));
    if (lanes == 0) return;
    HWY_ALIGN std::uint32_t key[16];
    HWY_ALIGN std::int32_t at[3][16];
    hn::Store(keys, du, key);
    for (int a = 0; a < 3; ++a) hn::Store(hn::Add(b[a], hn::Set(di, job_.base[a])), di, at[a]);
    __asm__ volatile("" ::: "memory");  // loads, not lanes taken out of vectors one by one
    for (unsigned m = lanes; m != 0; m &= m - 1) {
      const auto n = static_cast<std::size_t>(__builtin_ctz(m));
      if (key[n] == last_[step]) continue;
      last_[step] = key[n];
      const std::int32_t here[3] = {at[0][n], at[1][n], at[2][n]};
      if (missing(job_, here)) found_[count_++] = block_key(here[0], here[1], here[2]);
    }
  }
  [[nodiscard]] int count() const { return count_; }

 private:
  const BandJob& job_;
  std::uint64_t* found_;
  int count_ = 0;
  std::uint32_t last_[kBandMost];  // of each step; no key at first: no ray is that far out
};

BandCount find_missing_row(const BandJob& job, const BandRow& row) {
  const DF df;
  const DI di;
  const DU du;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const VF one = hn::Set(df, 1.0F), huge = hn::Set(df, 1e30F);
  const VF y = hn::Set(df, row.y);
  Emit emit(job, row.found);
  BandCount count;
  for (int u = 0; u < row.rays; u += lanes) {
    const auto px = hn::LoadU(du, row.pixels + u);
    const VI weight = hn::BitCast(di, hn::And(hn::ShiftRight<16>(px), hn::Set(du, 0xffU)));
    const MF active = hn::RebindMask(
        df, hn::And(hn::Gt(weight, hn::Zero(di)), hn::Lt(hn::Iota(di, u), hn::Set(di, row.rays))));
    unsigned todo = bits_of(active);
    if (todo == 0) continue;
    count.rays += __builtin_popcount(todo);
    const VF z = hn::Mul(hn::ConvertTo(df, hn::BitCast(di, hn::And(px, hn::Set(du, 0xffffU)))),
                         hn::Set(df, 1e-3F));
    const VF reach =
        hn::Mul(hn::ConvertTo(df, hn::BitCast(di, hn::ShiftRight<24>(px))), hn::Set(df, 0.03125F));
    const VF x = hn::LoadU(df, row.x + u);
    const VF length = hn::Sqrt(hn::Add(hn::Add(one, hn::Mul(x, x)), hn::Mul(y, y)));
    const VF half = hn::Div(hn::Mul(hn::Set(df, job.truncation_m), reach), length);
    const VF from = hn::Sub(z, half), to = hn::Add(z, half);
    VI b[3], e[3], sign[3];
    VF t[3], dt[3];
    VI steps = hn::Zero(di);
    for (int a = 0; a < 3; ++a) {
      const VF dir = hn::Add(
          hn::Add(hn::Mul(x, hn::Set(df, job.axes[0][a])), hn::Mul(y, hn::Set(df, job.axes[1][a]))),
          hn::Set(df, job.axes[2][a]));
      const VF o = hn::Set(df, job.origin[a]);
      const VF q0 = hn::IfThenElseZero(active, hn::Add(o, hn::Mul(from, dir)));
      const VF q1 = hn::IfThenElseZero(active, hn::Add(o, hn::Mul(to, dir)));
      b[a] = floor_of(q0), e[a] = floor_of(q1);
      steps = hn::Add(steps, hn::Abs(hn::Sub(e[a], b[a])));
      const VF d = hn::Sub(q1, q0);
      const MF up = hn::Gt(d, hn::Zero(df));
      sign[a] = hn::IfThenElse(hn::RebindMask(di, up), hn::Set(di, 1), hn::Set(di, -1));
      const MF moves = hn::RebindMask(df, hn::Ne(e[a], b[a]));
      dt[a] = hn::Div(one, hn::IfThenElse(moves, hn::Abs(d), one));
      const VF wall = hn::ConvertTo(df, b[a]);
      const VF way = hn::IfThenElse(up, hn::Sub(hn::Add(wall, one), q0), hn::Sub(q0, wall));
      t[a] = hn::IfThenElse(moves, hn::Mul(way, dt[a]), huge);
    }
    emit(0, b, todo);
    for (int s = 0; s + 1 < kBandMost; ++s) {
      const MF walks = hn::And(active, hn::RebindMask(df, hn::Gt(steps, hn::Set(di, s))));
      todo = bits_of(walks);
      if (todo == 0) break;
      const MF y_first = hn::Le(t[0], t[1]);  // x before y
      const MF x_z = hn::Le(t[0], t[2]), y_z = hn::Le(t[1], t[2]);
      const MF on_x = hn::And(walks, hn::And(y_first, x_z));
      const MF on_y = hn::And(walks, hn::AndNot(y_first, y_z));
      const MF on_z = hn::AndNot(on_y, hn::AndNot(on_x, walks));
      const MF on[3] = {on_x, on_y, on_z};
      for (int a = 0; a < 3; ++a) {
        b[a] = hn::Add(b[a], hn::IfThenElseZero(hn::RebindMask(di, on[a]), sign[a]));
        const MF end = hn::RebindMask(df, hn::Eq(b[a], e[a]));
        t[a] = hn::IfThenElse(on[a], hn::IfThenElse(end, huge, hn::Add(t[a], dt[a])), t[a]);
      }
      emit(s + 1, b, todo);
    }
  }
  count.found = emit.count();
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {
HWY_EXPORT(find_missing_row);

int floor_of(float x) noexcept {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(static_cast<float>(i) > x);
}

// One ray; returns how many keys were written.
int walk(const BandJob& job, float x, float y, float from, float to,
         std::uint64_t* found) noexcept {
  std::int32_t b[3], e[3], sign[3];
  float t[3], dt[3];
  int steps = 0, count = 0;
  for (int a = 0; a < 3; ++a) {
    const float dir = x * job.axes[0][a] + y * job.axes[1][a] + job.axes[2][a];
    const float q0 = job.origin[a] + from * dir, q1 = job.origin[a] + to * dir, d = q1 - q0;
    b[a] = floor_of(q0), e[a] = floor_of(q1);
    steps += std::abs(e[a] - b[a]);
    sign[a] = d > 0 ? 1 : -1;
    const bool moves = e[a] != b[a];
    dt[a] = 1.0F / (moves ? std::fabs(d) : 1.0F);
    const auto wall = static_cast<float>(b[a]);
    t[a] = moves ? (d > 0 ? wall + 1.0F - q0 : q0 - wall) * dt[a] : 1e30F;
  }
  for (int s = 0;; ++s) {
    const std::int32_t here[3] = {b[0] + job.base[0], b[1] + job.base[1], b[2] + job.base[2]};
    if (missing(job, here)) found[count++] = block_key(here[0], here[1], here[2]);
    if (s >= steps || s + 1 >= kBandMost) return count;
    const int a = t[0] <= t[1] ? (t[0] <= t[2] ? 0 : 2) : (t[1] <= t[2] ? 1 : 2);
    b[a] += sign[a];
    t[a] = b[a] == e[a] ? 1e30F : t[a] + dt[a];
  }
}

}  // namespace

BandCount find_missing_scalar(const BandJob& job, const BandRow& row) noexcept {
  BandCount count;
  for (int u = 0; u < row.rays; ++u) {
    const std::uint32_t px = row.pixels[u];
    if (((px >> 16U) & 0xffU) == 0) continue;
    ++count.rays;
    const float x = row.x[u], z = static_cast<float>(px & 0xffffU) * 1e-3F;
    const float reach = static_cast<float>(px >> 24U) * 0.03125F;
    const float half = job.truncation_m * reach / std::sqrt(1.0F + x * x + row.y * row.y);
    count.found += walk(job, x, row.y, z - half, z + half, row.found + count.found);
  }
  return count;
}

BandCount find_missing(const BandJob& job, const BandRow& row) noexcept {
  if (simd::chosen() == simd::Isa::kScalar) return find_missing_scalar(job, row);
  return HWY_DYNAMIC_DISPATCH(find_missing_row)(job, row);
}

}  // namespace perception
#endif
