#include "drivers/codec/depth_filter.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "drivers/codec/depth_lattice.hpp"

namespace drivers::codec {

namespace {

constexpr int kGate = 4 * kPointsPerSigma;
constexpr int kFraction = 8;
constexpr int kMostAge = 64;  // readings that a mean remembers
constexpr int kMostDebt = 2047;

constexpr std::array<std::int32_t, kMostAge + 1> kShare = [] {
  std::array<std::int32_t, kMostAge + 1> t{};
  for (int n = 1; n <= kMostAge; ++n) t[static_cast<std::size_t>(n)] = 65536 / n;
  return t;
}();

// log2 of the frames between two refinements of a pixel of that age.
constexpr unsigned period_log2(int age) noexcept { return age < 16 ? 2 : age < 48 ? 3 : 4; }

// Blocks take turns: neighbours at different times.
unsigned turn(int bx, int by) noexcept {
  return static_cast<unsigned>(5 * bx + 3 * by + (bx >> 2) + 7 * (by >> 2));
}

}  // namespace

DepthFilter::DepthFilter(const StripeShape& most)
    : mean_(static_cast<std::size_t>(most.width * most.rows)),
      debt_(mean_.size()),
      age_(mean_.size()),
      target_(mean_.size()),
      due_(mean_.size()) {}

void DepthFilter::forget() noexcept { std::fill(age_.begin(), age_.end(), std::uint8_t{0}); }

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
  const bool quiet = demand.mode == DepthMode::kQuiet;
  const int within = std::max(0, demand.bound - demand.step / 2);
  std::uint32_t restless = 0;
  for (int row = 0; row < shape.rows; ++row) {
    for (int bx = 0; bx < shape.blocks_wide(); ++bx) {
      const unsigned now = demand.seq + turn(bx, row / kBlock);
      const auto first = static_cast<std::size_t>(row * shape.width + bx * kBlock);
      for (std::size_t i = first; i < first + kBlock; ++i) {
        const int x = reading[i], y = points[i];
        int age = age_[i];
        due_[i] = 0;
        if (x == 0) {
          restless += y != 0 ? 1 : 0;
          age_[i] = 0;
          target_[i] = 0;
          continue;
        }
        const int off = x - (mean_[i] >> kFraction);
        if (age == 0 || std::abs(off) > kGate) {
          ++restless;
          mean_[i] = x << kFraction;
          debt_[i] = 0;
          age_[i] = 1;
          target_[i] = static_cast<std::uint16_t>(x);
          due_[i] = 1;
          continue;
        }
        age = std::min(age + 1, kMostAge);
        age_[i] = static_cast<std::uint8_t>(age);
        mean_[i] += static_cast<int>(
            (std::int64_t{(x << kFraction) - mean_[i]} * kShare[static_cast<std::size_t>(age)]) >>
            16);
        const int mean = (mean_[i] + (1 << (kFraction - 1))) >> kFraction;
        const unsigned log2 = period_log2(age);
        const bool turn_now = quiet && (now & ((1U << log2) - 1)) == 0;
        const bool stays = y != 0 && std::abs(x - y) <= demand.bound;
        int goal = mean;
        if (turn_now || !stays) {
          if (quiet) goal += (debt_[i] + x - mean + (1 << log2 >> 1)) >> log2;
          due_[i] = 1;
        } else {
          goal = y;
        }
        target_[i] =
            static_cast<std::uint16_t>(std::max(1, std::clamp(goal, x - within, x + within)));
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
