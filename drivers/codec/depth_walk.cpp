#include "drivers/codec/depth_walk.hpp"

#include "drivers/codec/clones.hpp"

namespace drivers::codec {

namespace {

// Of the plane, in 64ths: the row above has weights 8 + 4 dx, the one above it -4 + 4 dx, and the
// row itself 19, 14, 11: the least-squares plane of these neighbours, rounded to what still
// reproduces any plane exactly.
TELETACT_CODEC_CLONES void predict(const std::uint16_t* up, const std::uint16_t* up2,
                                   std::int32_t* plane, std::int32_t* mean, int count) noexcept {
#pragma GCC ivdep
  for (int x = 0; x < count; ++x) {
    const std::uint16_t *n = up + x, *nn = up2 + x;
    const int near = n[-2] + n[-1] + n[0] + n[1] + n[2];
    const int far = nn[-2] + nn[-1] + nn[0] + nn[1] + nn[2];
    const int slope = 2 * (n[2] - n[-2] + nn[2] - nn[-2]) + n[1] - n[-1] + nn[1] - nn[-1];
    plane[x] = 4 * (2 * near - far + slope);
    mean[x] = 2 * n[0] + n[1] + n[-1];
  }
}

}  // namespace

void WalkRows::predict_rows(int x0, int x1) noexcept {
  predict(up + x0, up2 + x0, plane + x0, mean + x0, x1 - x0);
}

}  // namespace drivers::codec
