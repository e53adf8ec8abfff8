// What is to be shown of each pixel of a stripe: the encoder's memory in time.
//
// Per pixel with a reading x (points of the lattice), the value before y, the running mean m of the
// last n readings that lay within the gate of it, their mean deviations up and down, a and b, and
// the debt e = sum of (x - y) over these:
//
//   |x - m| > gate               another surface: m = x, n = 1, e = 0, x is coded at once
//   faithful                     y stays while |x - y| <= bound; else m, moved to within bound of x
//   quiet, once in P(n) frames   y = m + (e + x - m) / P: then the sum of y over the next P frames
//                                makes good what the frames before owe, and a fusion that averages
//                                what is shown averages what was seen. P = 8, 16 from n = 64 on:
//                                y moves ever closer to m. Blocks take turns.
//   quiet, between               y stays while |x - y| <= bound, the gate and a sigma; while n < 8
//                                three quarters of the gate
//   moving, lossless             x; nothing is remembered
//
// The gate is 5.25 v (4.2 sigma of a normal deviate), v = min(a + b, 4 a, 4 b): wider where a pixel
// is noisier than the sensor's axis says (a ray that goes beside its pixel on a slope), never more
// than the bound of x. Noise goes up and down. Readings that lie on one side are of a surface that
// moves, and must not widen the gate: the pixel would lag behind it, and show neither the surface
// that it was on nor the one that it is on. Only what passes the gate counts in a and b.
//
// A pixel without a reading shows none and forgets all.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/codec/depth_lattice.hpp"
#include "drivers/codec/depth_stream.hpp"
#include "drivers/codec/depth_stripe.hpp"

namespace drivers::codec {

struct FilterDemand {
  DepthMode mode = DepthMode::kFaithful;
  int step = 1;        // points
  int least_gate = 0;  // points
  int bound = 0;       // points: |shown - reading|, the rounding to a step included
  const std::int32_t* quiet_bound = nullptr;  // the same for quiet, by reading / kBoundCell;
                                              // at most kMostBound
  int near_points = 0;                        // readings below have the bound of the first cell
  std::uint32_t seq = 0;                      // of the frame: whose turn it is
};

inline constexpr int kBoundCell = 128;  // points
inline constexpr int kMostBound = 250;  // points: as 256ths they fit 16 bits

class DepthFilter {
 public:
  explicit DepthFilter(const StripeShape& most);

  // From `reading` (points; 0 = none) and the values before: target and due of every pixel, good as
  // long as `reading` is.
  // Number of restless ones: beyond the gate, or with a reading that was not there.
  [[nodiscard]] std::uint32_t plan(const StripeShape& shape, const FilterDemand& demand,
                                   const std::uint16_t* reading,
                                   const std::uint16_t* points) noexcept;
  // Books what is shown now.
  void settle(const StripeShape& shape, const FilterDemand& demand, const std::uint16_t* reading,
              const std::uint16_t* points) noexcept;
  [[nodiscard]] const std::uint16_t* target() const noexcept { return wanted_; }
  [[nodiscard]] const std::uint8_t* due() const noexcept { return due_.data(); }

 private:
  // The memory, each an array over the pixels of the stripe. In 16 bits: depth_filter_kernel.hpp.
  std::vector<std::uint16_t> mean_, fraction_;  // points, and 256ths of one
  std::vector<std::uint16_t> above_,
      below_;                       // mean deviations up, down: points, 8 bits of fraction
  std::vector<std::int16_t> debt_;  // points
  std::vector<std::uint16_t> age_;  // readings in the mean; 0: none
  std::vector<std::uint16_t> target_;
  std::vector<std::uint8_t> due_;
  // Of one row: whose turn it is, and the bound of each pixel.
  std::vector<std::uint16_t> turns_, most_;
  const std::uint16_t* wanted_ = nullptr;
  bool remembers_ = true;  // false: no age, all due
};

}  // namespace drivers::codec
