// Which pixels of a cell lie on the map's surface, vectors of pixels at once. Most of a static
// image does: what is left is looked at one by one (MotionWatch::gather_evidence()).
//
// A pixel is told to agree when the nearest node of its point is known and within `enough` of the
// surface, and nothing has been remembered of its place. Told so it does agree by the plain rule
// too; the others may.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "perception/tsdf/blocks/map_reader.hpp"

namespace perception::motion {

inline constexpr int kAcross = 8;  // pixels of a cell's row

struct AgreeJob {
  const float* z;  // pixel 0 of the first row; readable up to kAcross pixels, 0 beyond the image
  std::ptrdiff_t stride;  // floats from row to row
  const float* x_factor;
  const float* y_factor;  // of the first row
  unsigned rows;          // a bit for each that is looked at
  float R_W[9], t_W[3];   // row-major
  float inv_voxel;
  float metres_per_unit;
  // A node nearer than base + per_m2 max(z - from_m, 0)^2 is near enough.
  float base_m, per_m2, from_m;
  // One bit a place that may be remembered, by place_slot(); nullptr: none is.
  const std::uint32_t* places;
  float inv_place;
};

inline constexpr std::uint32_t kPlaceSlots = 1U << 15U;
// Where a place of these coordinates is kept.
[[nodiscard]] inline std::uint32_t place_slot(std::int32_t x, std::int32_t y,
                                              std::int32_t z) noexcept {
  const std::uint32_t h = static_cast<std::uint32_t>(x) * 73856093U ^
                          static_cast<std::uint32_t>(y) * 19349663U ^
                          static_cast<std::uint32_t>(z) * 83492791U;
  return (h ^ (h >> 15U)) & (kPlaceSlots - 1);
}

// A row of R_W times p plus t: in this order wherever a pixel's point is asked for.
[[nodiscard]] inline float turned(const float* R, float t, float x, float y, float z) noexcept {
  return (R[0] * x + (R[1] * y + R[2] * z)) + t;
}

// Of each row looked at: bit u, pixel u agrees (`agrees`); has a reading and does not, or may not
// (`others`).
struct RowBits {
  std::uint8_t agrees, others;
};
void find_agreeing(const AgreeJob& job, MapReader& reader, RowBits* rows) noexcept;
// The same, one pixel after the other: what the tests hold it against.
void find_agreeing_plain(const AgreeJob& job, MapReader& reader, RowBits* rows) noexcept;

// All readings are `others`.
inline void find_readings(const AgreeJob& job, RowBits* rows) noexcept {
  for (unsigned left = job.rows; left != 0; left &= left - 1) {
    const int r = std::countr_zero(left);
    unsigned readings = 0;
    for (unsigned u = 0; u < kAcross; ++u)
      readings |= (job.z[r * job.stride + u] > 0 ? 1U : 0U) << u;
    rows[r] = {0, static_cast<std::uint8_t>(readings)};
  }
}

}  // namespace perception::motion
