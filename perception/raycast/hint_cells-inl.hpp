// The map cells that rays of the tracking cast are in, and the field's value and gradient there.
// Included once per instruction set (Highway's way: no guard but the toggle).
#include <cstdint>
#include <cstring>

#include "perception/raycast/hint_kernel.hpp"
#include "perception/tsdf/blocks/chunk_directory.hpp"

#if defined(TELETACT_HINT_CELLS_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_HINT_CELLS_TOGGLE
#undef TELETACT_HINT_CELLS_TOGGLE
#else
#define TELETACT_HINT_CELLS_TOGGLE
#endif

#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

constexpr int kWidth = static_cast<int>(hn::MaxLanes(DF()));
constexpr int kRoom = HintJob::kSpan + 16;  // whole vectors are written

// Rays on their way, side by side in any order.
struct Rays {
  alignas(64) float d[3][kRoom];
  alignas(64) float t[kRoom], low[kRoom], high[kRoom], small[kRoom];
  alignas(64) std::int32_t ray[kRoom];  // which one of the span
  int size = 0;
};

// The cells that rays are in, and from where their nodes can be read.
struct Cells {
  alignas(64) float f[3][kRoom];
  alignas(64) std::uint32_t entry[kRoom], slot[kRoom], cell[kRoom];
  alignas(64) std::int32_t block[kRoom];
  std::uint64_t inside = 0, over[3] = {};  // a bit a ray; reaches into the next block along an axis
  const std::int32_t* p[kRoom];            // words 0, 1, 8, 9, 64, 65, 72, 73 from there
  // Cells in more than one block, put together as in one, 16 of them in 128 words.
  alignas(64) std::int32_t patched[8 * kRoom];
};
static_assert(HintJob::kSpan <= 64);

HWY_INLINE void locate(const HintJob& job, const Rays& rays, int at, Cells& out) {
  const DF df;
  const DI di;
  const DU du;
  const VI seven = hn::Set(di, 7), zero = hn::Zero(di);
  const VF t = hn::Load(df, rays.t + at);
  VI chunk[3], slot[3], cell[3];
  for (int a = 0; a < 3; ++a) {
    const VF p = hn::Add(hn::Set(df, job.origin[a]), hn::Mul(t, hn::Load(df, rays.d[a] + at)));
    const VF whole = hn::Floor(p);
    hn::Store(hn::Sub(p, whole), df, out.f[a] + at);
    const VI node = hn::Add(truncated(whole), hn::Set(di, job.base[a]));
    chunk[a] = hn::Sub(hn::ShiftRight<6>(node), hn::Set(di, job.corner[a]));
    slot[a] = hn::And(hn::ShiftRight<3>(node), seven);
    cell[a] = hn::And(node, seven);
  }
  const VI outside = hn::AndNot(hn::Set(di, ChunkDirectory::kEdge - 1),
                                hn::Or(hn::Or(chunk[0], chunk[1]), chunk[2]));
  const auto inside = hn::Eq(outside, zero);
  const auto join5 = [](const VI(&v)[3]) {
    return hn::Or(hn::ShiftLeft<10>(v[0]), hn::Or(hn::ShiftLeft<5>(v[1]), v[2]));
  };
  const auto join3 = [](const VI(&v)[3]) {
    return hn::Or(hn::ShiftLeft<6>(v[0]), hn::Or(hn::ShiftLeft<3>(v[1]), v[2]));
  };
  const auto put = [&](VI v, std::uint32_t* column) {
    hn::Store(hn::BitCast(du, v), du, column + at);
  };
  put(hn::IfThenElseZero(inside, join5(chunk)), out.entry);
  put(join3(slot), out.slot), put(join3(cell), out.cell);
  const auto bits = [&](auto mask) {
    return static_cast<std::uint64_t>(bits_of(hn::RebindMask(df, mask))) << at;
  };
  out.inside |= bits(inside);
  for (int a = 0; a < 3; ++a) out.over[a] |= bits(hn::Eq(cell[a], seven));
}

// Block and first word of each ray's cell: plain loads, and no branch from one to the next.
HWY_INLINE void find_blocks(const HintJob& job, int size, Cells& c) {
  for (int n = 0; n < size; ++n) {
    const std::int32_t found =
        job.tables[static_cast<std::uint32_t>(job.directory[c.entry[n]]) + c.slot[n]];
    const std::int32_t block = found < 0 ? job.empty_block : found;
    c.block[n] = block;
    c.p[n] = job.words + ((static_cast<std::size_t>(block) << 9U) + c.cell[n]);
  }
}

// A cell's own copy of its nodes, the `used`-th.
HWY_INLINE std::int32_t* own_words(Cells& cells, int used) {
  return cells.patched + ((used & 3) * 2 + ((used >> 2) & 3) * 16 + (used >> 4) * 128);
}

// Two words by one store: the load of both that follows soon would wait for two.
HWY_INLINE void put_pair(std::int32_t low, std::int32_t high, std::int32_t* to) {
  const std::uint64_t both = static_cast<std::uint32_t>(low) |
                             static_cast<std::uint64_t>(static_cast<std::uint32_t>(high)) << 32U;
  std::memcpy(to, &both, sizeof both);
}

// Puts together the cells of `rays`, which reach into the next block along one axis.
template <int kAxis>
HWY_INLINE int patch_pair(const HintJob& job, std::uint64_t rays, int used, Cells& cells) {
  constexpr std::uint32_t kBit = 4U >> kAxis, kRow = 7U << (3 * (2 - kAxis));
  for (; rays != 0; rays &= rays - 1, ++used) {
    const auto n = static_cast<std::size_t>(__builtin_ctzll(rays));
    const auto next =
        static_cast<std::size_t>(job.ahead[8 * static_cast<std::size_t>(cells.block[n]) + kBit]);
    const std::int32_t* const p = cells.p[n];
    const std::int32_t* const q = job.words + ((next << 9U) + (cells.cell[n] & ~kRow));
    std::int32_t* const own = own_words(cells, used);
    constexpr std::ptrdiff_t kAt[4] = {0, 8, 64, 72};  // bit 1: x + 1, bit 0: y + 1
    for (unsigned k = 0; k < 4; ++k) {
      if constexpr (kAxis == 2) {
        put_pair(p[kAt[k]], q[kAt[k]], own + kAt[k]);
      } else {  // corners that differ in z lie side by side
        const bool over = (k & (kAxis == 0 ? 2U : 1U)) != 0;
        const std::ptrdiff_t from = over ? kAt[k & (kAxis == 0 ? 1U : 2U)] : kAt[k];
        std::memcpy(own + kAt[k], (over ? q : p) + from, 2 * sizeof *own);
      }
    }
    cells.p[n] = own;
  }
  return used;
}

// The same along more than one axis.
HWY_INLINE void patch_any(const HintJob& job, std::uint64_t rays, int used, Cells& cells) {
  for (; rays != 0; rays &= rays - 1, ++used) {
    const auto n = static_cast<std::size_t>(__builtin_ctzll(rays));
    const std::uint32_t c = cells.cell[n];
    const std::uint32_t x[2] = {c & 0x1c0U, (c + 64U) & 0x1c0U},
                        y[2] = {c & 0x38U, (c + 8U) & 0x38U}, z[2] = {c & 7U, (c + 1U) & 7U};
    const std::uint32_t m =
        (x[0] > x[1] ? 4U : 0U) | (y[0] > y[1] ? 2U : 0U) | (z[0] > z[1] ? 1U : 0U);
    const std::int32_t* const ahead = job.ahead + 8 * static_cast<std::size_t>(cells.block[n]);
    std::int32_t* const own = own_words(cells, used);
    const auto word = [&](std::uint32_t k) {
      const auto block = static_cast<std::size_t>(ahead[k & m]);
      return job.words[(block << 9U) + (x[k >> 2U] | y[(k >> 1U) & 1U] | z[k & 1U])];
    };
    for (std::uint32_t k = 0; k < 8; k += 2)
      put_pair(word(k), word(k + 1), own + (k >> 2U) * 64 + ((k >> 1U) & 1U) * 8);
    cells.p[n] = own;
  }
}

HWY_INLINE void patch(const HintJob& job, Cells& cells) {
  const std::uint64_t x = cells.over[0] & cells.inside, y = cells.over[1] & cells.inside,
                      z = cells.over[2] & cells.inside;
  int used = patch_pair<0>(job, x & ~(y | z), 0, cells);
  used = patch_pair<1>(job, y & ~(x | z), used, cells);
  used = patch_pair<2>(job, z & ~(x | y), used, cells);
  patch_any(job, (x & y) | (y & z) | (z & x), used, cells);
}

struct Corners {
  VF v[8];  // raw units; corner bit 2 = x+1, bit 1 = y+1, bit 0 = z+1
  MF known;
};

// Two neighbouring words at p[lane] + at of every lane, as the low and the high word of 64 bits;
// sorted into vectors of low and of high words.
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

HWY_INLINE Corners read_cells(const HintJob& job, const std::int32_t* const* p) {
  const DI di;
  const DU du;
  const DF df;
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
  out.known = hn::RebindMask(df, hn::Gt(weight, hn::Set(di, need)));
  return out;
}

struct Value {
  VF f, g[3];
  MF known;
};

HWY_INLINE Value value_at(const HintJob& job, const Cells& cells, int at) {
  const DF df;
  const Corners c = read_cells(job, cells.p + at);
  const VF f[3] = {hn::Load(df, cells.f[0] + at), hn::Load(df, cells.f[1] + at),
                   hn::Load(df, cells.f[2] + at)};
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

HWY_INLINE void find_cells(const HintJob& job, const Rays& rays, Cells& cells) {
  cells.inside = cells.over[0] = cells.over[1] = cells.over[2] = 0;
  int size = 0;
  for (; size < rays.size; size += kWidth) locate(job, rays, size, cells);
  find_blocks(job, size, cells);
  patch(job, cells);
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
