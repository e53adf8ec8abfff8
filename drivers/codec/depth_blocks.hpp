// Which prediction a block takes: the encoder's choice alone, the decoder is told.
//
// Estimated from the readings of every second row, because the values of the neighbours as decoded
// are not known yet; bits of a residual of r steps are taken as 0.5 + 2 log2(1 + r).
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/codec/depth_stripe.hpp"

namespace drivers::codec {

class BlockChoice {
 public:
  explicit BlockChoice(const StripeShape& most);
  // `plan.kinds` need not be set: kinds() is what it is to be. Number of blocks that are not
  // copies.
  [[nodiscard]] std::uint32_t choose(const StripeShape& shape, int step, const StripePlan& plan,
                                     const std::uint16_t* points) noexcept;
  [[nodiscard]] const std::uint8_t* kinds() const noexcept { return kinds_.data(); }

 private:
  [[nodiscard]] Prediction cheapest(const StripeShape& shape, const StripePlan& plan,
                                    const std::uint16_t* points, int x0, int y0) const noexcept;
  std::uint64_t inverse_ = 0;
  std::vector<std::uint8_t> kinds_;
};

}  // namespace drivers::codec
