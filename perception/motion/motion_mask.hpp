// What a pixel of a depth image shows: the place, something that moves in it, or the robot itself.
#pragma once

#include <cstdint>

namespace perception {

enum class PixelOf : std::uint8_t {
  kPlace = 0,   // or nobody knows
  kMoving = 1,  // moves against the map: neither tracked by, nor fused, nor carving
  kBody = 2,    // the robot's own body, or what it holds
};

}  // namespace perception
