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
constexpr std::uint32_t kAlone = kCost[12];  // of a pixel without what it is predicted from
constexpr int kFewNew = 16;                  // pixels that may be predicted alone beside copies
constexpr std::uint32_t kStays = 3;          // of a pixel that is not due, sixteenths of a bit

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

bool all_there(const std::uint16_t* points, int count) noexcept {
  bool all = true;
  for (int i = 0; i < count; ++i) all &= points[i] != 0;
  return all;
}

// How far off each prediction in space is, of a row of a block; points.
constexpr std::array kSpatial{Prediction::kPlane, Prediction::kEdge, Prediction::kMean};
using SpatialOffs = std::array<std::array<std::uint16_t, kBlock>, kSpatial.size()>;

// Reads three pixels to the left and two to the right. What lies there at an image's border is of
// another row, and what comes of it is not used.
TELETACT_CODEC_CLONES void measure(const std::uint16_t* v, const std::uint16_t* up,
                                   const std::uint16_t* up2, std::uint16_t* off_plane,
                                   std::uint16_t* off_edge, std::uint16_t* off_mean) noexcept {
  const auto capped = [](int d) {
    return static_cast<std::uint16_t>(std::min(std::abs(d), static_cast<int>(kMostPoints) - 1));
  };
#pragma GCC ivdep
  for (int k = 0; k < kBlock; ++k) {
    const std::uint16_t *w = v + k, *n = up + k;
    const RowsAbove above = rows_above(n, up2 + k);
    off_plane[k] = capped(*w - plane_prediction(above.plane, w[-1], w[-2], w[-3]));
    off_edge[k] = capped(*w - edge_prediction(w[-1], n[0], n[-1]));
    off_mean[k] = capped(*w - mean_prediction(above.mean, w[-1], w[-2]));
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

void BlockChoice::price_time(const StripePlan& plan, const std::uint16_t* points, int at,
                             Costs& cost) const noexcept {
  std::uint32_t& time = cost[static_cast<std::size_t>(Prediction::kTime)];
  for (int i = at; i < at + kBlock; ++i) {
    if (plan.target[i] == 0) continue;
    if (points[i] == 0) {
      time += kAlone;
    } else {
      const auto off = static_cast<std::size_t>(std::abs(plan.target[i] - points[i]));
      time += plan.due[i] != 0 ? cost_[std::min(off, kMostPoints - 1)] : kStays;
    }
  }
}

bool BlockChoice::price_space(const std::uint16_t* target, int width, int x0, int at,
                              Costs& cost) const noexcept {
  const std::uint16_t *const v = target + at, *const up = v - width;
  // Pixels that lack a neighbour: their predictions cost the same.
  const auto lacks = [&](int i) {
    return x0 + i < 3 || x0 + i + 2 >= width || v[i - 1] == 0 || v[i - 2] == 0 || v[i - 3] == 0 ||
           up[i - 1] == 0 || up[i] == 0 || up[i + 1] == 0 || up[i + 2] == 0;
  };
  const bool inside = x0 >= 3 && x0 + kBlock + 1 < width;
  const bool all = inside && all_there(v - 3, kBlock + 3) && all_there(up - 1, kBlock + 3);
  SpatialOffs off;
  measure(v, up, up - width, off[0].data(), off[1].data(), off[2].data());
  bool any = all;
  for (int i = 0; i < kBlock; ++i) {
    if (!all && v[i] == 0) continue;
    const bool alone = !all && lacks(i);
    any |= !alone;
    const auto k = static_cast<std::size_t>(i);
    for (std::size_t p = 0; p < kSpatial.size(); ++p) {
      cost[static_cast<std::size_t>(kSpatial[p])] += alone ? kAlone : cost_[off[p][k]];
    }
  }
  return any;
}

Prediction BlockChoice::cheapest(const StripeShape& shape, const StripePlan& plan,
                                 const std::uint16_t* points, int x0, int y0) const noexcept {
  Costs cost{};
  bool any = false;
  for (const int y : {y0 + 3, y0 + 6}) {
    const int at = y * shape.width + x0;
    price_time(plan, points, at, cost);
    any |= price_space(plan.target, shape.width, x0, at, cost);
  }
  const auto of = [&](Prediction p) { return cost[static_cast<std::size_t>(p)]; };
  Prediction best = Prediction::kEdge;
  if (any && of(Prediction::kPlane) < of(best)) best = Prediction::kPlane;
  if (any && of(Prediction::kMean) < of(best)) best = Prediction::kMean;
  return of(Prediction::kTime) <= of(best) ? Prediction::kTime : best;
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
