#include "drivers/codec/depth_filter.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "drivers/codec/depth_filter_rules.hpp"

namespace drivers::codec {

namespace {

constexpr int kFraction = 8;
// Readings that a mean remembers, and log2 of the frames between two refinements of a pixel, before
// its mean has so many and after.
// chosen on: depth scene seed 1, 12 and 40 frames; judged on: depth scene seeds 5 and 11
constexpr int kMostAge = 64;
constexpr unsigned kYoungPeriod = 3, kOldPeriod = 4;

constexpr int kMostDebt = 2047;
// A pixel not known yet deviates as far up and down as sigma's does.
constexpr int kDeviation = (kPointsPerSigma << kFraction) * 2 / 5;

// How fast the mean deviations follow: a 16th.
// chosen on: teletact bench codec seed 1; judged on: seeds 2, 3, 21 to 24
constexpr int kFollow = 4;

constexpr std::array<std::int32_t, kMostAge + 1> kShare = [] {
  std::array<std::int32_t, kMostAge + 1> t{};
  for (int n = 1; n <= kMostAge; ++n) t[static_cast<std::size_t>(n)] = 65536 / n;
  return t;
}();

constexpr unsigned period_log2(int age) noexcept {
  return age < kMostAge ? kYoungPeriod : kOldPeriod;
}

// Blocks take turns: neighbours at different times.
unsigned turn(int bx, int by) noexcept {
  return static_cast<unsigned>(5 * bx + 3 * by + (bx >> 2) + 7 * (by >> 2));
}

}  // namespace

void DepthFilter::Pixel::spread_by(int off) noexcept {
  const int up = std::max(off, 0) << kFraction, down = std::max(-off, 0) << kFraction;
  above = static_cast<std::uint16_t>(above + ((up - above) >> kFollow));
  below = static_cast<std::uint16_t>(below + ((down - below) >> kFollow));
}

DepthFilter::DepthFilter(const StripeShape& most)
    : pixels_(static_cast<std::size_t>(most.width * most.rows)),
      target_(pixels_.size()),
      due_(pixels_.size()) {}

DepthFilter::Goal DepthFilter::judge(Pixel& p, int x, int y, unsigned now,
                                     const FilterDemand& demand) noexcept {
  const bool quiet = demand.mode == DepthMode::kQuiet;
  const int most = demand.quiet_bound[x / kBoundCell];
  const int off = x - (p.mean >> kFraction);
  if (p.age == 0 && y == 0) p.above = p.below = kDeviation;
  const int own =
      FilterRules::spread(p.above, p.below) * FilterRules::kGateQuarters >> (kFraction + 2);
  const int gate = std::min(std::max(own, demand.least_gate), most);
  if (p.age == 0 || std::abs(off) > gate) {
    p.mean = x << kFraction;
    p.debt = 0;
    p.age = 1;
    return {x, true, true};
  }
  const int bound = quiet ? FilterRules::stays_within(p.age, gate, most) : demand.bound;
  p.spread_by(off);
  const int age = std::min(p.age + 1, kMostAge);
  p.age = static_cast<std::uint8_t>(age);
  const std::int64_t towards = (x << kFraction) - p.mean;
  p.mean += static_cast<int>((towards * kShare[static_cast<std::size_t>(age)]) >> 16);
  const int mean = (p.mean + (1 << (kFraction - 1))) >> kFraction;
  const unsigned log2 = period_log2(age);
  const bool turn_now = quiet && (now & ((1U << log2) - 1)) == 0;
  const bool stays = y != 0 && std::abs(x - y) <= bound;
  const int within = std::max(0, bound - demand.step / 2);
  const auto near = [&](int goal) { return std::max(1, std::clamp(goal, x - within, x + within)); };
  if (stays && !turn_now) return {near(y), false, false};
  const int owed = quiet ? (p.debt + x - mean + (1 << log2 >> 1)) >> log2 : 0;
  // What is less than five eighths of a step can wait: the debt keeps it.
  if (quiet && stays && 8 * std::abs(mean + owed - y) < 5 * demand.step)
    return {near(y), false, false};
  return {near(mean + owed), true, false};
}

std::uint32_t DepthFilter::plan(const StripeShape& shape, const FilterDemand& demand,
                                const std::uint16_t* reading,
                                const std::uint16_t* points) noexcept {
  const bool still = demand.mode == DepthMode::kFaithful || demand.mode == DepthMode::kQuiet;
  if (!still) {
    if (remembers_) {
      for (Pixel& p : pixels_) p.age = 0;
      std::fill(due_.begin(), due_.end(), std::uint8_t{1});
    }
    remembers_ = false;
    wanted_ = reading;
    return 0;
  }
  remembers_ = true;
  wanted_ = target_.data();
  std::uint32_t restless = 0;
  for (int row = 0; row < shape.rows; ++row) {
    for (int bx = 0; bx < shape.blocks_wide(); ++bx) {
      const unsigned now = demand.seq + turn(bx, row / kBlock);
      const auto first = static_cast<std::size_t>(row * shape.width + bx * kBlock);
      for (std::size_t i = first; i < first + kBlock; ++i) {
        if (reading[i] == 0) {
          restless += points[i] != 0 ? 1 : 0;
          pixels_[i].age = 0;
          target_[i] = 0;
          due_[i] = 0;
          continue;
        }
        const Goal goal = judge(pixels_[i], reading[i], points[i], now, demand);
        restless += goal.restless ? 1 : 0;
        target_[i] = static_cast<std::uint16_t>(goal.target);
        due_[i] = goal.due ? 1 : 0;
      }
    }
  }
  return restless;
}

void DepthFilter::settle(const StripeShape& shape, const FilterDemand& demand,
                         const std::uint16_t* reading, const std::uint16_t* points) noexcept {
  if (demand.mode != DepthMode::kQuiet) return;
  const auto n = static_cast<std::size_t>(shape.width * shape.rows);
  for (std::size_t i = 0; i < n; ++i) {
    const int debt = pixels_[i].debt + reading[i] - points[i];
    pixels_[i].debt = static_cast<std::int16_t>(std::clamp(debt, -kMostDebt, kMostDebt));
  }
}

}  // namespace drivers::codec
