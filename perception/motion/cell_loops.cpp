#include "perception/motion/cell_loops.hpp"

#include <cstring>

#include "perception/simd/clones.hpp"

namespace perception::motion {
namespace {

// Eight cells, and four of them in fp64. Tables are read up to a multiple of eight, which they have
// room for.
using Float8 = float __attribute__((vector_size(32)));
using Int8 = std::int32_t __attribute__((vector_size(32)));
using Double4 = double __attribute__((vector_size(32)));
constexpr int kAtOnce = 8;
static_assert(CellSums::kMost % kAtOnce == 0);

// Inlined into each version of a loop; a vector returned by a call would be passed in its own way
// by each.
#define CELLS_INLINE __attribute__((always_inline)) inline
#define CELLS_LAMBDA __attribute__((always_inline))
CELLS_INLINE void load(const float* from, Float8& out) noexcept {
  std::memcpy(&out, from, sizeof out);
}
CELLS_INLINE void load(const float* from, Double4& out) noexcept {
  // GCC 12 makes one instruction of this, and ten of __builtin_convertvector().
  out = Double4{static_cast<double>(from[0]), static_cast<double>(from[1]),
                static_cast<double>(from[2]), static_cast<double>(from[3])};
}

// Lanes of cells beyond the last are not to be counted: bits set where they are.
CELLS_INLINE void lanes_below(int first, int end, Int8& out) noexcept {
  const Int8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
  out = lane + first < end;
}

}  // namespace

TELETACT_CLONES
void misfit_of(const CellSums& sums, const float (&linear)[6], const float (&square)[21],
               const PerCell& limit2, PerCell& misfit) noexcept {
  const Float8 none = {}, one = none + 1.0F;
  for (int c = 0; c < sums.size(); c += kAtOnce) {
    Float8 sum, v, pairs, limit;
    load(sums.r2.data() + c, sum);
#pragma GCC unroll 6
    for (std::size_t i = 0; i < 6; ++i) load(sums.g[i].data() + c, v), sum += linear[i] * v;
#pragma GCC unroll 21
    for (std::size_t i = 0; i < 21; ++i) load(sums.H[i].data() + c, v), sum += square[i] * v;
    load(sums.pairs.data() + c, pairs);
    load(limit2.data() + c, limit);
    pairs = pairs < one ? one : pairs;
    sum = (sum < none ? none : sum) / (pairs * limit);
    std::memcpy(misfit.data() + c, &sum, sizeof sum);
  }
}

TELETACT_CLONES
void weigh(const CellSums& sums, const PerCell& weight, float least, WeightedSums& out) noexcept {
  alignas(32) double w[CellSums::kMost];
  const int end = sums.size();
  for (int c = 0; c < end; c += kAtOnce) {
    Float8 of_cell, pairs;
    load(weight.data() + c, of_cell);
    load(sums.pairs.data() + c, pairs);
    Int8 counts;
    lanes_below(c, end, counts);
    counts &= (pairs >= least) & (of_cell > 0.0F);
    of_cell = counts ? of_cell : Float8{};
    for (int k = 0; k < kAtOnce; ++k) w[c + k] = static_cast<double>(of_cell[k]);
  }
  const auto padded = (end + kAtOnce - 1) / kAtOnce * kAtOnce;
  // As many sums at a time as there are registers: three times seven of H, then g and the pairs.
  constexpr std::size_t kTogether = 7;
  const auto sum_up = [&](const auto& entry, double* total) CELLS_LAMBDA {
    Double4 sum[kTogether] = {};
    for (int c = 0; c < padded; c += 4) {
      Double4 by, v;
      std::memcpy(&by, w + c, sizeof by);
#pragma GCC unroll 7
      for (std::size_t i = 0; i < kTogether; ++i) load(entry(i) + c, v), sum[i] += by * v;
    }
    for (std::size_t i = 0; i < kTogether; ++i)
      total[i] = (sum[i][0] + sum[i][1]) + (sum[i][2] + sum[i][3]);
  };
  for (std::size_t first = 0; first < 21; first += kTogether) {
    const auto* H = &sums.H[first];
    sum_up([H](std::size_t i) CELLS_LAMBDA { return H[i].data(); }, out.H + first);
  }
  double rest[kTogether];
  sum_up([&](std::size_t i) CELLS_LAMBDA { return i < 6 ? sums.g[i].data() : sums.pairs.data(); },
         rest);
  std::memcpy(out.g, rest, sizeof out.g);
  out.pairs = rest[6];
}

TELETACT_CLONES
double supported(const CellSums& sums, const PerCell& misfit, const PerCell& weight, float scale,
                 float least) noexcept {
  Double4 low = {}, high = {};
  const int end = sums.size();
  for (int c = 0; c < end; c += kAtOnce) {
    Float8 of_cell, pairs, m;
    load(weight.data() + c, of_cell);
    load(sums.pairs.data() + c, pairs);
    load(misfit.data() + c, m);
    Int8 counts;
    lanes_below(c, end, counts);
    counts &= pairs >= least;
    of_cell = of_cell * pairs / (1.0F + m / scale);
    of_cell = counts ? of_cell : Float8{};
    float four[kAtOnce];
    std::memcpy(four, &of_cell, sizeof four);
    Double4 v;
    load(four, v), low += v;
    load(four + 4, v), high += v;
  }
  low += high;
  return (low[0] + low[1]) + (low[2] + low[3]);
}

}  // namespace perception::motion
