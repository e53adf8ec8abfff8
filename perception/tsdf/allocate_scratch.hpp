// Working memory of allocation.
#pragma once

#include <array>
#include <cstdint>

#include "perception/tsdf/band_kernel.hpp"
#include "perception/tsdf/depth_pyramid.hpp"

namespace perception {

struct AllocateScratch {
  std::array<float, DepthPyramid::kMaxWidth + 16> x{};
  std::array<std::uint64_t, static_cast<std::size_t>(DepthPyramid::kMaxWidth) * kBandMost> keys{};
};

}  // namespace perception
