// Which prediction a block takes: the encoder's choice alone, the decoder is told.
//
// Estimated from the readings of two of its rows, because the values of the neighbours as decoded
// are not known yet; bits of a residual of r steps are taken as 0.5 + 2 log2(1 + r).
#pragma once

#include <array>
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
  // Of a row of a block, from pixel `at` of the stripe on: what each prediction would cost.
  using Costs = std::array<std::uint32_t, 5>;
  void price_time(const StripePlan& plan, const std::uint16_t* points, int at,
                  Costs& cost) const noexcept;
  // False: no pixel has all that it would be predicted from.
  [[nodiscard]] bool price_space(const std::uint16_t* target, int width, int x0, int at,
                                 Costs& cost) const noexcept;
  void price(int step) noexcept;
  int step_ = 0;                     // that cost_ is for
  std::vector<std::uint16_t> cost_;  // of a residual of so many points
  // Of the columns of a row of blocks: pixels with a reading, with validity as before, with both,
  // and of these to change.
  std::vector<std::uint16_t> there_, kept_, both_, due_;
  std::vector<std::uint8_t> kinds_;
};

}  // namespace drivers::codec
