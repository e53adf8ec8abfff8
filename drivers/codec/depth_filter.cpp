#include "drivers/codec/depth_filter.hpp"

#include <algorithm>

#include "drivers/codec/clones.hpp"
#include "drivers/codec/depth_filter_kernel.hpp"

namespace drivers::codec {

namespace {

constexpr int kMostDebt = 2047;  // points

// Blocks take turns: neighbours at different times.
unsigned turn(int bx, int by) noexcept {
  return static_cast<unsigned>(5 * bx + 3 * by + (bx >> 2) + 7 * (by >> 2));
}

// The bound of each reading of a row. Near the camera it is one for all.
TELETACT_CODEC_CLONES void bound_row(const std::uint16_t* reading, const std::int32_t* bounds,
                                     int near_points, std::uint16_t* most, int width) noexcept {
  std::uint16_t furthest = 0;
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) furthest = std::max(furthest, reading[i]);
  if (furthest < near_points) {
    std::fill_n(most, width, static_cast<std::uint16_t>(bounds[0]));
    return;
  }
  for (int i = 0; i < width; ++i) {
    most[i] = static_cast<std::uint16_t>(bounds[reading[i] / kBoundCell]);
  }
}

TELETACT_CODEC_CLONES void book(std::int16_t* debt, const std::uint16_t* reading,
                                const std::uint16_t* points, int count) noexcept {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const int now = debt[i] + reading[i] - points[i];
    debt[i] = static_cast<std::int16_t>(std::clamp(now, -kMostDebt, kMostDebt));
  }
}

}  // namespace

DepthFilter::DepthFilter(const StripeShape& most)
    : mean_(static_cast<std::size_t>(most.width * most.rows)),
      fraction_(mean_.size()),
      above_(mean_.size()),
      below_(mean_.size()),
      debt_(mean_.size()),
      age_(mean_.size()),
      target_(mean_.size()),
      due_(mean_.size()),
      turns_(static_cast<std::size_t>(most.width)),
      most_(turns_.size()) {}

std::uint32_t DepthFilter::plan(const StripeShape& shape, const FilterDemand& demand,
                                const std::uint16_t* reading,
                                const std::uint16_t* points) noexcept {
  const bool still = demand.mode == DepthMode::kFaithful || demand.mode == DepthMode::kQuiet;
  if (!still) {
    if (remembers_) {
      std::fill(age_.begin(), age_.end(), std::uint16_t{0});
      std::fill(due_.begin(), due_.end(), std::uint8_t{1});
    }
    remembers_ = false;
    wanted_ = reading;
    return 0;
  }
  remembers_ = true;
  wanted_ = target_.data();
  const auto u16 = [](int v) { return static_cast<std::uint16_t>(v); };
  // What is less than five eighths of a step can wait: the debt keeps it.
  const FilterLaw law{u16(demand.least_gate), u16(demand.bound), u16(demand.step / 2),
                      u16((5 * demand.step + 7) / 8)};
  std::uint32_t restless = 0;
  for (int y = 0; y < shape.rows; ++y) {
    if (y % kBlock == 0) {
      for (int x = 0; x < shape.width; ++x) {
        turns_[static_cast<std::size_t>(x)] =
            static_cast<std::uint16_t>(demand.seq + turn(x / kBlock, y / kBlock));
      }
    }
    const auto at = static_cast<std::ptrdiff_t>(y) * shape.width;
    bound_row(reading + at, demand.quiet_bound, demand.near_points, most_.data(), shape.width);
    const FilterRow row{mean_.data() + at,   fraction_.data() + at, above_.data() + at,
                        below_.data() + at,  debt_.data() + at,     age_.data() + at,
                        target_.data() + at, due_.data() + at,      reading + at,
                        points + at,         turns_.data(),         most_.data()};
    restless += demand.mode == DepthMode::kQuiet ? judge_quiet(row, law, shape.width)
                                                 : judge_faithful(row, law, shape.width);
  }
  return restless;
}

void DepthFilter::settle(const StripeShape& shape, const FilterDemand& demand,
                         const std::uint16_t* reading, const std::uint16_t* points) noexcept {
  if (demand.mode != DepthMode::kQuiet) return;
  book(debt_.data(), reading, points, shape.width * shape.rows);
}

}  // namespace drivers::codec
