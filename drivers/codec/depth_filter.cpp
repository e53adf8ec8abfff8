#include "drivers/codec/depth_filter.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "drivers/codec/depth_lattice.hpp"

namespace drivers::codec {

namespace {

constexpr int kFraction = 8;
// Readings that a mean remembers, and log2 of the frames between two refinements of a pixel, before
// its mean has so many and after.
// chosen on: depth scene seed 1, 12 and 40 frames; judged on: depth scene seeds 5 and 11
constexpr int kMostAge = 64;
constexpr unsigned kYoungPeriod = 3, kOldPeriod = 4;

constexpr int kMostDebt = 2047;
constexpr int kSpread = 8 * kPointsPerSigma * 4 / 5;  // of a pixel not known yet: sigma's

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

DepthFilter::DepthFilter(const StripeShape& most)
    : mean_(static_cast<std::size_t>(most.width * most.rows)),
      debt_(mean_.size()),
      age_(mean_.size()),
      spread_(mean_.size()),
      target_(mean_.size()),
      due_(mean_.size()) {}

void DepthFilter::forget() noexcept { std::fill(age_.begin(), age_.end(), std::uint8_t{0}); }

DepthFilter::Goal DepthFilter::judge(std::size_t i, int x, int y, unsigned now,
                                     const FilterDemand& demand) noexcept {
  const bool quiet = demand.mode == DepthMode::kQuiet;
  const int bound = quiet ? demand.slope_bound[x / kBoundCell] : demand.bound;
  const int most = demand.slope_bound[x / kBoundCell] - kPointsPerSigma;
  const int off = std::abs(x - (mean_[i] >> kFraction));
  const bool fresh = age_[i] == 0;
  if (fresh && y == 0) spread_[i] = kSpread;
  const int gate = std::clamp(spread_[i] * 21 >> 5, demand.least_gate, most);
  if (fresh || off > gate) {
    mean_[i] = x << kFraction;
    debt_[i] = 0;
    age_[i] = 1;
    return {x, true, true};
  }
  // Only of what passes the gate: a pixel that flips between two surfaces must not widen it.
  spread_[i] =
      static_cast<std::uint8_t>(std::min(spread_[i] + (((off << 3) - spread_[i]) >> 3), 255));
  const int age = std::min(age_[i] + 1, kMostAge);
  age_[i] = static_cast<std::uint8_t>(age);
  const std::int64_t towards = (x << kFraction) - mean_[i];
  mean_[i] += static_cast<int>((towards * kShare[static_cast<std::size_t>(age)]) >> 16);
  const int mean = (mean_[i] + (1 << (kFraction - 1))) >> kFraction;
  const unsigned log2 = period_log2(age);
  const bool turn_now = quiet && (now & ((1U << log2) - 1)) == 0;
  const bool stays = y != 0 && std::abs(x - y) <= bound;
  const int within = std::max(0, bound - demand.step / 2);
  const auto near = [&](int goal) { return std::max(1, std::clamp(goal, x - within, x + within)); };
  if (stays && !turn_now) return {near(y), false, false};
  const int owed = quiet ? (debt_[i] + x - mean + (1 << log2 >> 1)) >> log2 : 0;
  // What is less than five eighths of a step can wait: the debt keeps it.
  if (quiet && stays && 8 * std::abs(mean + owed - y) < 5 * demand.step)
    return {near(y), false, false};
  return {near(mean + owed), true, false};
}

std::uint32_t DepthFilter::plan(const StripeShape& shape, const FilterDemand& demand,
                                const std::uint16_t* reading,
                                const std::uint16_t* points) noexcept {
  const bool still = demand.mode == DepthMode::kFaithful || demand.mode == DepthMode::kQuiet;
  const auto n = static_cast<std::size_t>(shape.width * shape.rows);
  if (!still) {
    std::copy_n(reading, n, target_.data());
    std::fill_n(due_.data(), n, std::uint8_t{1});
    std::fill_n(age_.data(), n, std::uint8_t{0});
    return 0;
  }
  std::uint32_t restless = 0;
  for (int row = 0; row < shape.rows; ++row) {
    for (int bx = 0; bx < shape.blocks_wide(); ++bx) {
      const unsigned now = demand.seq + turn(bx, row / kBlock);
      const auto first = static_cast<std::size_t>(row * shape.width + bx * kBlock);
      for (std::size_t i = first; i < first + kBlock; ++i) {
        if (reading[i] == 0) {
          restless += points[i] != 0 ? 1 : 0;
          age_[i] = 0;
          target_[i] = 0;
          due_[i] = 0;
          continue;
        }
        const Goal goal = judge(i, reading[i], points[i], now, demand);
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
    const int debt = debt_[i] + reading[i] - points[i];
    debt_[i] = static_cast<std::int16_t>(std::clamp(debt, -kMostDebt, kMostDebt));
  }
}

}  // namespace drivers::codec
