#include "drivers/codec/depth_blocks.hpp"

#include <algorithm>
#include <array>

#include "drivers/codec/clones.hpp"
#include "drivers/codec/depth_stream.hpp"

namespace drivers::codec {

namespace {

constexpr int kCosts = 128;
// Sixteenths of a bit for a residual of i quarters of a step: 8 + 32 log2(1 + i / 4), in integers
// by the binary logarithm's series of squarings.
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

constexpr std::size_t kMostPoints =
    kCosts / 4 * static_cast<std::size_t>(kDepthStepEighths.back()) + 1;

struct Columns {
  std::uint16_t *there, *kept, *both, *due;
};

TELETACT_CODEC_CLONES void count_row(const Columns c, const std::uint16_t* reading,
                                     const std::uint16_t* points, const std::uint8_t* due,
                                     int width) noexcept {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const unsigned now = reading[x] != 0 ? 1 : 0, then = points[x] != 0 ? 1 : 0;
    c.there[x] = static_cast<std::uint16_t>(c.there[x] + now);
    c.kept[x] = static_cast<std::uint16_t>(c.kept[x] + (now == then ? 1U : 0U));
    c.both[x] = static_cast<std::uint16_t>(c.both[x] + (now & then));
    c.due[x] = static_cast<std::uint16_t>(c.due[x] + (now & then & due[x]));
  }
}

int sum(const std::uint16_t* column) noexcept {
  int s = 0;
  for (int i = 0; i < kBlock; ++i) s += column[i];
  return s;
}

}  // namespace

BlockChoice::BlockChoice(const StripeShape& most)
    : cost_(kMostPoints),
      there_(static_cast<std::size_t>(most.width)),
      kept_(there_.size()),
      both_(there_.size()),
      due_(there_.size()),
      kinds_(static_cast<std::size_t>(most.blocks())) {}

void BlockChoice::price(int step) noexcept {
  if (step == step_) return;
  step_ = step;
  const std::uint64_t inverse = (std::uint64_t{4} << 32U) / static_cast<unsigned>(step);
  for (std::size_t d = 0; d < cost_.size(); ++d) {
    cost_[d] = kCost[std::min<std::size_t>((d * inverse) >> 32U, kCosts - 1)];
  }
}

Prediction BlockChoice::cheapest(const StripeShape& shape, const StripePlan& plan,
                                 const std::uint16_t* points, int x0, int y0) const noexcept {
  const int w = shape.width;
  std::array<std::uint32_t, 5> cost{};
  const auto add = [&](Prediction p, int d) {
    const auto points_off = static_cast<std::size_t>(std::abs(d));
    cost[static_cast<std::size_t>(p)] += cost_[std::min(points_off, kMostPoints - 1)];
  };
  bool any = false;
  for (const int y : {y0 + 3, y0 + 6}) {
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
        const int near = up[-2] + up[-1] + up[0] + up[1] + up[2];
        const int far = n[-2] + n[-1] + n[0] + n[1] + n[2];
        const int slope = 2 * (up[2] - up[-2] + n[2] - n[-2]) + up[1] - up[-1] + n[1] - n[-1];
        const int plane = 4 * (2 * near - far + slope) + 19 * v[-1] + 14 * v[-2] + 11 * v[-3];
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
  price(step);
  std::uint32_t coded = 0;
  int block = 0;
  for (int y0 = 0; y0 < shape.rows; y0 += kBlock) {
    for (auto* column : {&there_, &kept_, &both_, &due_}) {
      std::fill(column->begin(), column->end(), std::uint16_t{0});
    }
    for (int y = y0; y < y0 + kBlock; ++y) {
      const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape.width;
      count_row({there_.data(), kept_.data(), both_.data(), due_.data()}, plan.reading + at,
                points + at, plan.due + at, shape.width);
    }
    for (int x0 = 0; x0 < shape.width; x0 += kBlock, ++block) {
      const int there = sum(there_.data() + x0), kept = sum(kept_.data() + x0),
                both = sum(both_.data() + x0), due = sum(due_.data() + x0);
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
