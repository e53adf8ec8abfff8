// Working memory of allocation: the image's rows in bands, each with room for what its rows lack.
#pragma once

#include <array>
#include <cstdint>

#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/integrate/band_kernel.hpp"

namespace perception {

struct AllocateScratch {
  static constexpr std::size_t kMostARow =
      static_cast<std::size_t>(DepthPyramid::kMaxWidth) * kBandMost;
  struct Band {
    std::array<std::uint64_t, kMostARow + 1024> keys;
    std::array<std::uint32_t, DepthPyramid::kMaxWidth + 16> pixels;  // of the row that is looked at
    std::uint32_t end;    // of the keys; a row's in order, each once
    int rows_seen, rays;  // looked at
  };
  static constexpr int kBands = 4;
  [[nodiscard]] static int first_row(int rows, int band) noexcept { return rows * band / kBands; }
  [[nodiscard]] static int last_row(int rows, int band) noexcept {
    return rows * (band + 1) / kBands;
  }
  std::array<float, DepthPyramid::kMaxWidth + 16> x{};
  std::array<Band, kBands> bands{};
};

}  // namespace perception
