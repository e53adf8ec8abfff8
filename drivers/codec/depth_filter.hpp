// What is to be shown of each pixel of a stripe: the encoder's memory in time.
//
// Per pixel with a reading x (points of the lattice), the value before y, the running mean m of the
// last n readings that lay within the gate of it, their mean deviation v, and the debt e = sum of
// (x - y) over these:
//
//   |x - m| > gate               another surface: m = x, n = 1, e = 0, x is coded at once
//   faithful                     y stays while |x - y| <= bound; else m, moved to within bound of x
//   quiet, once in P(n) frames   y = m + (e + x - m) / P: then the sum of y over the next P frames
//                                makes good what the frames before owe, and a fusion that averages
//                                what is shown averages what was seen. P = 8, 16 from n = 64 on:
//                                y moves ever closer to m. Blocks take turns.
//   moving, lossless             x; nothing is remembered
//
// The gate is 5.25 v (4.2 sigma of a normal deviate): wider where a pixel is noisier than the
// sensor's axis says (a ray that goes beside its pixel on a slope), never more than one sigma less
// than the bound of x. Only what passes the gate counts in v.
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
  int step = 1;        // points
  int least_gate = 0;  // points
  int bound = 0;       // points: |shown - reading|, the rounding to a step included
  const std::uint8_t* slope_bound = nullptr;  // quiet: the same by reading / kBoundCell
  std::uint32_t seq = 0;                      // of the frame: whose turn it is
};

inline constexpr int kBoundCell = 128;  // points

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
  struct Goal {
    int target;
    bool due;
    bool restless;
  };
  [[nodiscard]] Goal judge(std::size_t i, int x, int y, unsigned now,
                           const FilterDemand& demand) noexcept;
  std::vector<std::int32_t> mean_;    // points, 8 bits of fraction
  std::vector<std::int16_t> debt_;    // points
  std::vector<std::uint8_t> age_;     // readings in the mean; 0: none
  std::vector<std::uint8_t> spread_;  // mean deviation, eighths of a point
  std::vector<std::uint16_t> target_;
  std::vector<std::uint8_t> due_;
};

}  // namespace drivers::codec
