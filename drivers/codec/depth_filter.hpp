// What is to be shown of each pixel of a stripe: the encoder's memory in time.
//
// Per pixel with a reading x (points of the lattice), the value before y, the running mean m of the
// last n readings that lay within the gate of it, and the debt e = sum of (x - y) over these:
//
//   |x - m| > gate               another surface: m = x, n = 1, e = 0, x is coded at once
//   faithful                     y stays while |x - y| <= bound; else m, moved to within bound of x
//   quiet, once in P(n) frames   y = m + (e + x - m) / P: then the sum of y over the next P frames
//                                makes good what the frames before owe, and a fusion that averages
//                                what is shown averages what was seen. P grows with n (4, 8, 16),
//                                so
//                                y moves ever closer to m. Blocks take turns.
//   moving, lossless             x; nothing is remembered
//
// A pixel without a reading shows none and forgets all.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "drivers/codec/depth_stripe.hpp"

namespace drivers::codec {

struct FilterDemand {
  DepthMode mode = DepthMode::kFaithful;
  int step = 1;           // points
  int bound = 0;          // points: |shown - reading|, the rounding to a step included
  std::uint32_t seq = 0;  // of the frame: whose turn it is
};

class DepthFilter {
 public:
  explicit DepthFilter(const StripeShape& most);
  void forget() noexcept;

  // From `reading` (points; 0 = none) and the values before: target and due of every pixel.
  // Number of restless ones: beyond the gate, or with a reading that was not there.
  [[nodiscard]] std::uint32_t plan(const StripeShape& shape, const FilterDemand& demand,
                                   const std::uint16_t* reading,
                                   const std::uint16_t* points) noexcept;
  // Books what is shown now.
  void settle(const StripeShape& shape, const FilterDemand& demand, const std::uint16_t* reading,
              const std::uint16_t* points) noexcept;
  [[nodiscard]] const std::uint16_t* target() const noexcept { return target_.data(); }
  [[nodiscard]] const std::uint8_t* due() const noexcept { return due_.data(); }

 private:
  struct Pixel;
  std::vector<std::int32_t> mean_;  // points, 8 bits of fraction
  std::vector<std::int16_t> debt_;  // points
  std::vector<std::uint8_t> age_;   // readings in the mean; 0: none
  std::vector<std::uint16_t> target_;
  std::vector<std::uint8_t> due_;
};

}  // namespace drivers::codec
