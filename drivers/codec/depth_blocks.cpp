#include "drivers/codec/depth_blocks.hpp"

#include <array>

namespace drivers::codec {

namespace {

constexpr int kCosts = 128;
// Sixteenths of a bit for a residual of i quarters of a step: 8 + 32 log2(1 + i / 4), in integers by
// the binary logarithm's series of squarings.
constexpr std::array<std::uint16_t, kCosts> kCost = [] {
  std::array<std::uint16_t, kCosts> t{};
  for (std::size_t i = 0; i < kCosts; ++i) {
    std::uint64_t v = (4 + i) << 14U;  // (1 + i / 4) in 1/2^16
    std::uint32_t log = 0;             // log2 in 1/32
    while (v >= std::uint64_t{2} << 16U) v >>= 1U, log += 32;
    for (std::uint32_t bit = 16; bit > 0; bit /= 2) {
      v = v * v >> 16U;
      if (v >= std::uint64_t{2} << 16U) v >>= 1U, log += bit;
    }
    t[i] = static_cast<std::uint16_t>(8 + log);
  }
  return t;
}();
constexpr int kFewNew = 16;          // pixels that may be predicted alone beside copies
constexpr std::uint32_t kStays = 3;  // of a pixel that is not due, sixteenths of a bit

}  // namespace

BlockChoice::BlockChoice(const StripeShape& most)
    : kinds_(static_cast<std::size_t>(most.blocks())) {}

Prediction BlockChoice::cheapest(const StripeShape& shape, const StripePlan& plan,
                                 const std::uint16_t* points, int x0, int y0) const noexcept {
  const int w = shape.width;
  std::array<std::uint32_t, 5> cost{};
  const auto add = [&](Prediction p, int d) {
    const auto q = (static_cast<std::uint64_t>(std::abs(d)) * inverse_) >> 32U;
    cost[static_cast<std::size_t>(p)] += kCost[std::min<std::size_t>(q, kCosts - 1)];
  };
  bool any = false;
  for (int y = y0 + 1; y < y0 + kBlock; y += 2) {
    for (int x = x0; x < x0 + kBlock; ++x) {
      const int i = y * w + x;
      const std::uint16_t* v = plan.target + i;
      if (*v == 0) continue;
      if (points[i] == 0) {
        cost[static_cast<std::size_t>(Prediction::kTime)] += kCost[12];
      } else if (plan.due[i] != 0) {
        add(Prediction::kTime, *v - points[i]);
      } else {
        cost[static_cast<std::size_t>(Prediction::kTime)] += kStays;
      }
      const std::uint16_t* const up = v - w;
      if (x < 3 || x + 2 >= w || v[-1] == 0 || v[-2] == 0 || v[-3] == 0 || up[-1] == 0 ||
          up[0] == 0 || up[1] == 0 || up[2] == 0) {
        for (const auto p : {Prediction::kPlane, Prediction::kEdge, Prediction::kMean})
          cost[static_cast<std::size_t>(p)] += kCost[12];
        continue;
      }
      any = true;
      add(Prediction::kEdge, *v - edge_prediction(v[-1], up[0], up[-1]));
      add(Prediction::kMean, *v - ((3 * v[-1] + v[-2] + 2 * up[0] + up[1] + up[-1] + 4) >> 3));
      if (y >= 2 && x >= 2) {
        const std::uint16_t* const n = up - w;
        const int plane = 18 * v[-1] + 14 * v[-2] + 10 * v[-3] + up[-2] + 5 * up[-1] + 9 * up[0] +
                          13 * up[1] + 16 * up[2] - 12 * n[-2] - 8 * n[-1] - 5 * n[0] + 3 * n[2];
        add(Prediction::kPlane, *v - ((plane + 32) >> 6));
      } else {
        add(Prediction::kPlane, *v - edge_prediction(v[-1], up[0], up[-1]));
      }
    }
  }
  const auto at = [&](Prediction p) { return cost[static_cast<std::size_t>(p)]; };
  Prediction best = Prediction::kEdge;
  if (any && at(Prediction::kPlane) < at(best)) best = Prediction::kPlane;
  if (any && at(Prediction::kMean) < at(best)) best = Prediction::kMean;
  return at(Prediction::kTime) <= at(best) ? Prediction::kTime : best;
}

std::uint32_t BlockChoice::choose(const StripeShape& shape, int step, const StripePlan& plan,
                                  const std::uint16_t* points) noexcept {
  inverse_ = (std::uint64_t{4} << 32U) / static_cast<unsigned>(step);
  std::uint32_t coded = 0;
  int block = 0;
  for (int y0 = 0; y0 < shape.rows; y0 += kBlock) {
    for (int x0 = 0; x0 < shape.width; x0 += kBlock, ++block) {
      int there = 0, kept = 0, due = 0, both = 0;  // with a reading; validity as before; to change
      for (int y = y0; y < y0 + kBlock; ++y) {
        for (int i = y * shape.width + x0; i < y * shape.width + x0 + kBlock; ++i) {
          const int now = plan.reading[i] != 0 ? 1 : 0, then = points[i] != 0 ? 1 : 0;
          there += now;
          kept += now == then ? 1 : 0;
          both += now & then;
          due += now & then & plan.due[i];
        }
      }
      unsigned kind = kEmptyBlock;
      if (there > 0 || kept == kBlock * kBlock) {
        const Validity v = kept == kBlock * kBlock    ? Validity::kAsBefore
                           : there == kBlock * kBlock ? Validity::kAll
                                                      : Validity::kMixed;
        const bool copy = due == 0 && there - both <= kFewNew;
        kind = block_kind(v, copy ? Prediction::kCopy : cheapest(shape, plan, points, x0, y0));
      }
      kinds_[static_cast<std::size_t>(block)] = static_cast<std::uint8_t>(kind);
      coded += kind != kSameBlock ? 1 : 0;
    }
  }
  return coded;
}

}  // namespace drivers::codec
