// The pixels above, left, right and below of a pixel, in that order; below 0: beyond the image.
#pragma once

#include <array>

namespace perception {

// Of pixel `i` of an image of `size` pixels, row-major, `width` of them in a row.
[[nodiscard]] inline std::array<int, 4> four_neighbours(int i, int width, int size) noexcept {
  const int u = i % width;
  return {i - width, u > 0 ? i - 1 : -1, u < width - 1 ? i + 1 : -1,
          i + width < size ? i + width : -1};
}

}  // namespace perception
