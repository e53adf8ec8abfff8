// The filter in time, one row of pixels: DepthFilter's inner loop, once per instruction set. All
// give the same bytes.
//
// Every value fits 16 bits, so that a vector holds as many pixels as can be: points are below 2^15,
// a bound is at most kMostBound, and what is computed of a reading beyond its gate is not used.
#pragma once

#include <cstdint>

#include "drivers/codec/depth_filter.hpp"

namespace drivers::codec {

inline constexpr int kFilterFraction = 8;  // bits, of means and deviations
// Readings that a mean remembers, and log2 of the frames between two refinements of a pixel, before
// its mean has so many and after.
// chosen on: depth scene seed 1, 12 and 40 frames; judged on: depth scene seeds 5 and 11
inline constexpr int kMostAge = 64;
inline constexpr int kYoungPeriod = 3, kOldPeriod = 4;
// How fast the mean deviations follow: a 16th.
// chosen on: teletact bench codec seed 1; judged on: seeds 2, 3, 21 to 24
inline constexpr int kFollow = 4;
// A pixel not known yet deviates as far up and down as sigma's does.
inline constexpr int kUnknownDeviation = (kPointsPerSigma << kFilterFraction) * 2 / 5;

// One row of the memory and of what is seen; each a multiple of kBlock long.
struct FilterRow {
  std::uint16_t *mean, *fraction;  // points, 256ths of one
  std::uint16_t *above, *below;    // mean deviations, 256ths of a point
  std::int16_t* debt;              // points
  std::uint16_t *age, *target;
  std::uint8_t* due;
  const std::uint16_t *reading, *points;
  const std::uint16_t* turns;  // refined where the lowest bits are 0
  const std::uint16_t* most;   // bound of the reading
};

struct FilterLaw {
  std::uint16_t least_gate, bound, half_step;
  std::uint16_t waits;  // a goal less far off than that can wait: the debt keeps it
};

// Number of restless pixels: beyond the gate, or with a reading that was not there.
[[nodiscard]] std::uint32_t judge_quiet(const FilterRow& row, const FilterLaw& law,
                                        int width) noexcept;
[[nodiscard]] std::uint32_t judge_faithful(const FilterRow& row, const FilterLaw& law,
                                           int width) noexcept;

}  // namespace drivers::codec
