// What the four wheels disagree about: the part of `w` (rad/s) that no body twist explains. Not
// zero means a slipping or stuck wheel.
#pragma once

#include "drivers/youbot/mecanum.hpp"

[[nodiscard]] inline double disagreement(const drivers::WheelVector& w) noexcept {
  return (w[0] - w[1] - w[2] + w[3]) / 4;
}
