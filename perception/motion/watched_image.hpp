// What the parts of MotionWatch share of the image that is looked at.
#pragma once

#include <cstdint>

#include "perception/icp/cell_sums.hpp"

namespace perception::motion {

// The coarse image: a level of the pyramid, about 128 x 106 pixels. Pixel i lies at column i %
// width, row i / width.
struct WatchedImage {
  static constexpr int kMostWidth = CellSums::kMostColumns * CellSums::kEdge;
  static constexpr int kMostHeight = CellSums::kMostRows * CellSums::kEdge;
  static constexpr int kMost = kMostWidth * kMostHeight;
  static constexpr int kYoungMap = 25;  // claimed frames

  int width = 0, height = 0, level = 0;
  double map_voxel_m = 0.01;
  float voxel_m = 0.01F;    // the same
  double length_m = 1;      // mean depth
  std::uint64_t frame = 0;  // number of the image
  int recent = 0;           // frames that evidence is remembered for; 0: nothing moved of late
  int known = 0;            // claimed frames since the map began, up to kYoungMap

  [[nodiscard]] int size() const noexcept { return width * height; }
  [[nodiscard]] bool young() const noexcept { return known < kYoungMap; }
  [[nodiscard]] int columns() const noexcept {  // of cells
    return (width + CellSums::kEdge - 1) / CellSums::kEdge;
  }
  [[nodiscard]] int cell_of(int u, int v) const noexcept {
    return v / CellSums::kEdge * columns() + u / CellSums::kEdge;
  }
  [[nodiscard]] float depth_m(const DepthLevel& live, int i) const noexcept {
    return live.depth.row(i / width)[i % width];
  }
  // The point of a pixel, in the camera C.
  [[nodiscard]] Vec3f point_C(const DepthLevel& live, int i) const noexcept {
    const int u = i % width, v = i / width;
    const float z = live.depth.row(v)[u];
    constexpr int kMargin = PaddedImage::kMargin;
    return {live.x_factor[static_cast<std::size_t>(u + kMargin)] * z,
            live.y_factor[static_cast<std::size_t>(v + kMargin)] * z, z};
  }
};

}  // namespace perception::motion
