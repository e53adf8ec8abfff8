// Inner loops of render() over a row of pixels: random deviates, depth edges, axial noise, mm.
// Without branches, compiled for several instruction sets with the same bytes out of each, as in
// ray_tile.hpp.
#pragma once

#include <cstdint>

#include "drivers/camera/depth_noise.hpp"
#include "rt/random.hpp"

namespace drivers {

// Value u of rt::Random(seed, stream), counted from 0: a row draws many at once, and some of few.
class RowStream {
 public:
  RowStream(std::uint64_t seed, std::uint64_t stream) noexcept : key_(rt::mix64(seed, stream)) {}
  [[nodiscard]] std::uint64_t operator()(int u) const noexcept {
    return rt::mix64(key_ + 0x9e3779b97f4a7c15ULL * (static_cast<std::uint64_t>(u) + 1U));
  }

 private:
  std::uint64_t key_;
};

// Deviates 0 to n - 1 of the row: those of the high 32 bits of its values.
void draw_normals(const RowStream& stream, const NormalTable& normal, float* out, int n) noexcept;

// Which pixels are beside a depth edge (depth_noise.hpp), 1 or 0. In 1/m, 0: nothing there. `up`,
// `down`: the rows beside; null at the border. `step`: working memory of n.
struct InverseRows {
  const float *row, *up, *down;
};
void mark_edges(const InverseRows& inverse_m, float* step, std::uint8_t* beside, int n) noexcept;

// z_m + sigma(z_m) * scale * deviate, where there is a reading. `tilt` (null: none): what is added
// to sigma, times 0.1 mm z^1.5.
void shake_row(float* z_m, const float* deviate, const float* tilt, float scale, int n) noexcept;

// Cosine of the angle between ray and surface normal, from 1/m two pixels aside: 1/depth is linear
// on a plane. Across a depth edge the flatter side counts. `row`: v itself; `up`, `down`: two rows
// aside, null beyond the border.
struct TiltRow {
  InverseRows inverse_m;
  float fx, fy, cx, y;  // px; y: (v - cy) / fy
};
void incidence_row(const TiltRow& row, float* cosine, int n) noexcept;

// 1 / depth, 0 where nothing is.
void invert(const float* depth_m, float* inverse_m, int n) noexcept;

// mm: readings outside [lo_m, hi_m] become 0.
void quantise(const float* z_m, std::uint16_t* out_mm, int n, float lo_m, float hi_m) noexcept;

}  // namespace drivers
