// Ray-casts a World into an RgbdFrame: the synthetic camera's lens, and the tests' truth.
//
// Pixels are cast in tiles; a tile looks only at the shapes whose bounding sphere touches its
// frustum, and each of them goes over the whole tile at once, in double precision. Without noise a
// pixel's depth is World::ray_cast's, rounded to the nearest millimetre. A pixel without depth has
// no colour (perception/geometry/no_colour.hpp).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/camera/depth_noise.hpp"
#include "drivers/camera/ray_tile.hpp"
#include "drivers/world/world.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

struct DepthRange {
  double min_m = 0.4, max_m = 5.0;  // outside it a pixel reads 0
};

// Working memory of render(), for any image up to RgbdFrame's capacity and worlds of up to
// `max_shapes`.
struct RenderScratch {
  RenderScratch(rt::NonRealtime&, std::size_t max_shapes);
  std::vector<float> depth_m;             // before noise; 0 = nothing there
  std::vector<float> inverse_m;           // 1 / depth, 0 where nothing is; only where noise asks
  std::vector<float> tilt;                // of one row; only with noise by incidence
  std::vector<float> row;                 // working memory of one row: 1/m, or deviates
  std::vector<std::uint8_t> beside;       // of one row, 1: beside a depth edge
  std::vector<float> shift_u, shift_v;    // of the rays of one row of tiles, px; only with jitter
  std::vector<SeenShape> seen;            // the world from this pose
  std::vector<const SeenShape*> in_tile;  // what a tile may see
  bool colour = true;                     // false: depth alone, in less time
  // Index of the shape that the pixel's ray meets, -1: none. Filled if the caller sized it to
  // RgbdFrame::kMaxPixels.
  std::vector<std::int16_t> shape;
};

// Fills depth, colour, intrinsics, has_colour and seq of `out`; leaves `exposure`. Allocates
// nothing. The world is that of instant t. `carried`: shapes that exist for this image only, placed
// in W. The result is a function of the arguments only. Asserts that the scratch is large enough.
void render(const World& world, const perception::Intrinsics& intrinsics,
            const perception::Pose& X_WC, const DepthRange& range, const DepthNoise& noise,
            std::uint64_t seed, std::uint64_t seq, RenderScratch& scratch,
            perception::RgbdFrame& out, rt::Time t = World::kBeginning,
            std::span<const Shape> carried = {}) noexcept;

}  // namespace drivers
