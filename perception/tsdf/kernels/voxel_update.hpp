// The inner loop of integration: one frame into one block. The arithmetic is fixed to the
// operation, in float without contraction, so that every instruction set stores the same words:
//
//   p     = p0 + ((x dx + y dy) + z dz)          node (x,y,z) of the block in the camera frame
//   u, v  = (p.x / p.z) fx + (cx + 0.5), ...     floor is the pixel; none outside the image or p.z
//         < 0.05
//   sdf   = (depth - p.z) * sqrt(1 + (p.x/p.z)^2 + (p.y/p.z)^2)
//   limit = truncation * the pixel's reach (1 for pixels that only carve)
//   sdf > limit                 seen through: free. A known voxel learns +1 with weight 2, and its
//                               own weight counts at most kGoing: so a surface that has gone is
//                               forgotten in 8 frames, however long it stood
//   sdf > truncation and d < 0  seen through too: no surface lies so far behind a solid voxel. So
//                               things before a floor at a grazing angle, whose band is three
//                               truncations long, are forgotten as fast
//   |sdf| <= limit              fused with the pixel's weight, s = sdf / truncation clipped to +-1;
//                               free when sdf > 0, else not free
//   sdf < -limit                hidden: unchanged
//   d'    = round((d w + s w_o) / (w + w_o)), half away from 0;  w' = min(w + w_o, cap)
//   within colour_band_m of the surface, in integers:
//               readings' = min(readings + 1, 15); where the pixel has a colour (no_colour.hpp),
//               with n the number of coloured readings: c' = (c n + c_o + (n + 1) / 2) / (n + 1),
//               n' = min(n + 1, 15)
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace perception {

struct UpdateCamera {
  float fx, fy, cx_plus_half, cy_plus_half;  // px; cx + 0.5, cy + 0.5
  int width, height;
  const std::uint32_t* pixels;  // DepthPyramid::pixels(); [width * height] is 0
  float truncation_m;
  float units_per_m;                // 32767 / truncation
  std::int32_t weight_cap;          // raw
  alignas(64) float node[3][512];   // of a block, from its first one, in the camera frame, m
  float colour_band_m;              // negative: no colour
  const std::uint8_t* colour;       // r, g, b a pixel; all 0: none there
  std::ptrdiff_t colour_stride_px;  // pixels from row to row
  bool gather;                      // simd::gathers(): readings by that instruction

  // dx, dy, dz: from one node to the next along each world axis, in the camera frame, m.
  void place_nodes(const std::array<float, 3>& dx, const std::array<float, 3>& dy,
                   const std::array<float, 3>& dz) noexcept;
};

// chosen on: moving 1 odd; judged on: moving 1 even
inline constexpr std::uint32_t kSeenThrough = 256;  // raw weight of that
// Largest weight of a voxel that is seen through: (20 / 22)^8 < 1/2, so even the deepest voxel
// changes its sign within 8 frames. A silhouette that is seen through now and then, because of
// flying pixels, keeps its mean with the noise of 20 readings.
inline constexpr std::uint32_t kGoing = 20 * 128;

struct BlockCounts {
  std::int32_t fused = 0, carved = 0;
};

// Where a block is kept: 512 words and colours, 8 words of bits. next_words: of the block that
// comes after it, asked for meanwhile; may be its own.
struct BlockMemory {
  std::uint32_t* words;
  std::uint64_t* free;
  std::uint32_t* colours;
  const std::uint32_t* next_words;
};

// inside: all its nodes fall into the image.
BlockCounts update_block(const UpdateCamera& camera, const float (&p0)[3], bool inside,
                         const BlockMemory& block) noexcept;
// The reference: one voxel after the other.
BlockCounts update_block_scalar(const UpdateCamera& camera, const float (&p0)[3],
                                const BlockMemory& block) noexcept;

}  // namespace perception
