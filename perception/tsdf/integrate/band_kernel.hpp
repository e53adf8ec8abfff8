// Finds the blocks that the bands of one row of pixels pass through and that the map lacks.
//
// A ray's band runs from depth z - half to z + half, half = truncation * reach / sqrt(1 + x^2 +
// y^2). In units of a block, relative to block `base` near the camera, its ends are q = origin + z
// (x a0 + y a1 + a2); the walk from the block of one end to that of the other takes the nearest
// wall each time (Amanatides and Woo 1987). Floats: a coordinate is good to 2 um at 10 m. A fixed
// order of operations: every instruction set finds the same blocks.
#pragma once

#include <cstdint>

namespace perception {

struct BandJob {
  const std::int32_t* directory;  // ChunkDirectory
  const std::int32_t* tables;     // MapView::arrays()
  std::int32_t corner[3];
  std::int32_t base[3];  // block
  float origin[3];       // blocks
  float axes[3][3];      // [camera axis][grid axis], blocks a metre
  float truncation_m;
};

struct BandRow {
  const std::uint32_t*
      pixels;      // DepthPyramid::pixels() of the rays, side by side; readable 16 beyond `rays`
  const float* x;  // (u - cx) / fx of each, readable 16 beyond
  float y;
  int rays;
  std::uint64_t*
      found;  // block_key() of blocks that are missing, some more than once; kBandMost a ray
};

inline constexpr int kBandMost = 24;  // blocks of one ray: a band of 3 x 0.5 m at the finest voxels

// Sorts as (x, y, z).
[[nodiscard]] inline std::uint64_t block_key(std::int32_t x, std::int32_t y,
                                             std::int32_t z) noexcept {
  constexpr std::int64_t kShift = 1 << 20;
  return static_cast<std::uint64_t>((x + kShift) << 42 | (y + kShift) << 21 | (z + kShift));
}
[[nodiscard]] inline std::int32_t block_key_axis(std::uint64_t key, int axis) noexcept {
  return static_cast<std::int32_t>((key >> (21 * (2 - axis))) & 0x1fffffU) - (1 << 20);
}

struct BandCount {
  int rays = 0, found = 0;
};

[[nodiscard]] BandCount find_missing(const BandJob& job, const BandRow& row) noexcept;
// The reference: one ray after the other.
[[nodiscard]] BandCount find_missing_scalar(const BandJob& job, const BandRow& row) noexcept;

}  // namespace perception
