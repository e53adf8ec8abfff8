// The inner loop of the superpixels: one seed tried on the pixels of its window. A pixel keeps the
// seed with
// the least d = |I(x) - I(S)| + beta |P(x) - P(S)|, of equals the one that came first. Where the pixel or the seed
// has no colour the first three planes are left out of |I(x) - I(S)|.
#pragma once

#include <cstddef>
#include <cstdint>

namespace perception {

struct SeedWindow {
  static constexpr int kMaxPlanes = 4;

  const float* planes[kMaxPlanes];  // of the image, row-major
  int plane_count;                  // 3 or 4
  std::ptrdiff_t stride;            // pixels a row, of planes, best and nearest
  int u0, v0, u1, v1;               // half open
  float plane[kMaxPlanes], u, v;    // of the seed
  const float* known;               // 1 where the pixel has colour, else 0; nullptr: all have it
  float seed_known;                 // the same of the seed
  float beta;
  std::int32_t id;
  float* best;  // least distance so far
  std::int32_t* nearest;
};

// On the chosen instruction set (perception/simd/isa.hpp); the same operations, so the same bytes,
// as
void try_seed(const SeedWindow& window) noexcept;
// the reference: one pixel after the other.
void try_seed_scalar(const SeedWindow& window) noexcept;

}  // namespace perception
