// The tracking cast's usual case, many rays at once: live depth is nearly always the surface
// itself, so a Newton step or two along the ray from there find the crossing.
//
// One ray, in grid coordinates relative to `base` (parameter t = depth along the optical axis):
//   d     = (x a0 + y a1) + a2              voxel_t = 1 / sqrt(d.d)
//   near  = reach voxel_t                   tried only when first < t - near and t + near < last
//   at most kNewton times: cell of origin + t d, all eight nodes known; value f, gradient g of the
//   trilinear interpolant; g.d < 0; t += -f / g.d, to stay within (hint - near - voxel_t / 2,
//   hint + near + voxel_t / 2); done when the move is below kClose voxels
//   normal R g, facing the camera, or else no surface
// The same operations in the same order as RayMarcher::quick_root, so the same bytes.
#pragma once

#include <cstdint>

namespace perception {

struct HintJob {
  static constexpr int kSpan = 64;  // rays at most in one call
  // Voxels: a Newton step below it is the last. The field is close to linear over half a voxel.
  static constexpr float kClose = 0.5F;
  static constexpr int kNewton = 4;  // steps at most

  const std::int32_t* directory;  // ChunkDirectory: where a chunk's table begins in `tables`
  const std::int32_t* tables;     // block number of each of a chunk's 512 blocks, -1 = none
  const std::int32_t* words;      // 512 a block
  const std::int32_t* ahead;      // 8 a block: its neighbours, see MapLayout::Arrays
  std::int32_t empty_table;       // of a chunk without blocks
  std::int32_t empty_block;       // number of a block of zeros
  std::int32_t corner[3];         // chunk coordinates of directory entry (0, 0, 0)
  std::uint32_t least_word;       // smallest word that is known
  float origin[3];
  std::int32_t base[3];
  float axes[3][3];  // [camera axis][grid axis], grid units a metre
  float R[3][3];     // camera to world
  float reach;       // voxels
  float first, last;
};

// `count` <= kSpan rays of one row. Up to the next multiple of 16, `hint` and `x` must be readable
// (hint 0 there) and `found` writable.
struct HintSpan {
  const float* hint;  // m, 0 = none
  const float* x;     // (u - cx) / fx
  float y;
  int count;
  float* records;       // 4 floats a ray (nx, ny, nz, t), zeros where nothing was found
  std::uint8_t* found;  // 1: settled by the hint (a record, or a surface that faces away)
};

struct HintCount {
  std::int32_t hits = 0;
  std::int64_t steps = 0;  // cells read
};

[[nodiscard]] HintCount cast_hints(const HintJob& job, const HintSpan& span) noexcept;

}  // namespace perception
