// One tile of camera rays against one shape at a time: the inner loops of render().
//
// A ray is (x, y, 1) in the camera's frame, so its parameter t is the depth. Loops run over the
// whole tile without branches; compiled once each for the base instruction set, AVX2 and
// AVX-512, with the same bytes out of all (no fused multiply-add anywhere).
#pragma once

#include <array>
#include <cstdint>

#include "drivers/world/shape.hpp"

// The resolver of a clone runs before a sanitizer's runtime is up.
#if defined(__x86_64__) && !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define TELETACT_CAMERA_CLONES \
  __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define TELETACT_CAMERA_CLONES
#endif

namespace drivers {

struct RayTile {
  static constexpr int kWidth = 32, kHeight = 8, kSize = kWidth * kHeight;
  alignas(64) std::array<double, kSize> x, y;           // direction
  alignas(64) std::array<double, kSize> t;              // nearest entry so far
  alignas(64) std::array<std::int64_t, kSize> id;       // its shape, -1: none
  alignas(64) std::array<std::uint32_t, kSize> colour;  // r | g << 8 | b << 16
};

// A shape as this frame's camera sees it.
struct SeenShape {
  const Shape* shape = nullptr;
  std::int64_t id = 0;
  perception::Vec3 origin_S;  // the lens
  perception::Mat3 R_SC;      // d_S = R_SC (x, y, 1)
  perception::Vec3 centre_C;  // of the bounding sphere
  perception::Vec3 normal_C;  // planes
  // Only rays (x, y, 1) with x0 <= x <= x1 and y0 <= y <= y1 can meet it. Infinite for planes, and
  // for shapes that reach behind the lens.
  double x0, x1, y0, y1;
};

struct Lens {
  double fx, fy, cx, cy;  // px
};
// Row j of the tile's pixels: n of them from (u0, v) on, each shifted by its du_px, dv_px (null:
// none); further ones repeat the last.
void tile_pixels(RayTile& tile, int j, int u0, int v, int n, const float* du_px,
                 const float* dv_px) noexcept;
// The tile's x, y hold pixels, and hold directions afterwards.
void tile_aim(RayTile& tile, const Lens& lens) noexcept;

void tile_begin(RayTile& tile, double max_t) noexcept;
void tile_cast(RayTile& tile, const SeenShape& s) noexcept;
// Colours the rays whose nearest entry is this shape's.
void tile_paint(RayTile& tile, const SeenShape& s) noexcept;
// The first n rays of row j: depth, 0 where they meet nothing, and colour.
void tile_store(const RayTile& tile, int j, int n, float* depth_m,
                perception::Rgb* colour) noexcept;

}  // namespace drivers
