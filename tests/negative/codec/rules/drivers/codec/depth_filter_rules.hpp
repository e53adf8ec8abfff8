// False rules in the place of the product's: deviations to one side count as noise, and a value
// stays as long as the widest bound lets it. A pixel then lags behind a surface that moves.
#pragma once

#include "drivers/codec/depth_lattice.hpp"

namespace drivers::codec {

struct FilterRules {
  [[nodiscard]] static constexpr int spread(int above, int below) noexcept { return above + below; }
  static constexpr int kGateQuarters = 21;
  [[nodiscard]] static constexpr int stays_within(int, int, int most) noexcept { return most + 16; }
};

}  // namespace drivers::codec
