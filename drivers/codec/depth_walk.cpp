#include "drivers/codec/depth_walk.hpp"

#include "drivers/codec/clones.hpp"

namespace drivers::codec {

namespace {

TELETACT_CODEC_CLONES void predict(const std::uint16_t* up, const std::uint16_t* up2,
                                   std::int32_t* plane, std::int32_t* mean, int count) noexcept {
#pragma GCC ivdep
  for (int x = 0; x < count; ++x) {
    const RowsAbove above = rows_above(up + x, up2 + x);
    plane[x] = above.plane;
    mean[x] = above.mean;
  }
}

}  // namespace

void WalkRows::predict_rows(int x0, int x1) noexcept {
  predict(up + x0, up2 + x0, plane + x0, mean + x0, x1 - x0);
}

}  // namespace drivers::codec
