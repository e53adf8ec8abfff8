// The inner loop of integration: one frame into one block. The arithmetic is fixed to the operation,
// in float without contraction, so that every instruction set stores the same words:
//
//   p     = ((p0 + x dx) + y dy) + z dz          node (x,y,z) of the block in the camera frame
//   u, v  = (p.x / p.z) fx + cx, ...             nearest pixel; none outside the image or p.z < 0.05
//   sdf   = (depth - p.z) * sqrt(1 + (p.x/p.z)^2 + (p.y/p.z)^2)
//   limit = truncation * the pixel's reach (1 for pixels that only carve)
//   sdf > limit                 seen through: free; a known voxel learns +1 with weight 1
//   |sdf| <= limit              fused with the pixel's weight, s = sdf / truncation clipped to +-1;
//                               free when sdf > 0, else not free
//   sdf < -limit                hidden: unchanged
//   d'    = round((d w + s w_o) / (w + w_o)), half away from 0;  w' = min(w + w_o, cap)
#pragma once

#include <array>
#include <cstdint>

namespace perception {

struct UpdateCamera {
  float fx, fy, cx, cy;
  int width, height;
  const std::uint32_t* pixels;  // DepthPyramid::pixels(); [width * height] is 0
  float truncation_m;
  float units_per_m;          // 32767 / truncation
  std::int32_t weight_cap;    // raw
  float dx[3], dy[3], dz[3];  // one node along each world axis, in the camera frame, m
  float colour_band_m;
};

struct BlockCounts {
  std::int32_t fused = 0, carved = 0;
  bool coloured = false;  // some voxel lies in the colour band: Scratch::pixel and near are valid
};

struct UpdateScratch {
  alignas(64) std::array<std::int32_t, 512> pixel;  // index of the pixel each node fell on
  alignas(64) std::array<std::uint32_t, 512> reading;
  alignas(64) std::array<float, 512> z, stretch;
  alignas(64) std::array<std::uint8_t, 512> set_free, clear_free;
  alignas(64) std::array<std::uint8_t, 512> near;  // 1: fused and within the colour band
};

// words: 512 of the block; free: its 8 words of bits.
BlockCounts update_block(const UpdateCamera& camera, const float (&p0)[3], std::uint32_t* words,
                         std::uint64_t* free, UpdateScratch& scratch) noexcept;

}  // namespace perception
