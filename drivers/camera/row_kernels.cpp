#include "drivers/camera/row_kernels.hpp"

#include <cmath>

#include "drivers/camera/ray_tile.hpp"

namespace drivers {

namespace {

// How far each pixel's 1/depth is off the plane through its neighbours: the larger of left-right
// and up-down, without the one that lacks a neighbour.
TELETACT_CAMERA_CLONES
void steps(const InverseRows r, float* out, int n) noexcept {
  out[0] = out[n - 1] = 0;
  for (int u = 1; u + 1 < n; ++u) out[u] = std::abs(r.row[u - 1] - 2 * r.row[u] + r.row[u + 1]);
  if (r.up == nullptr || r.down == nullptr) return;
  for (int u = 0; u < n; ++u) {
    const float across = std::abs(r.up[u] - 2 * r.row[u] + r.down[u]);
    out[u] = out[u] < across ? across : out[u];
  }
}

TELETACT_CAMERA_CLONES
void above(const float* row, const float* step, std::uint8_t* beside, int n) noexcept {
  constexpr auto kEdge = static_cast<float>(DepthNoise::kEdgeStep);
  for (int u = 0; u < n; ++u) beside[u] = (row[u] > 0) & (step[u] > kEdge * row[u]) ? 1 : 0;
}

}  // namespace

TELETACT_CAMERA_CLONES
void draw_normals(const RowStream& stream, const NormalTable& normal, float* out, int n) noexcept {
  const RowStream row = stream;
  for (int i = 0; i < n; ++i) out[i] = normal(static_cast<std::uint32_t>(row(i) >> 32U));
}

void mark_edges(const InverseRows& inverse_m, float* step, std::uint8_t* beside, int n) noexcept {
  steps(inverse_m, step, n);
  above(inverse_m.row, step, beside, n);
}

TELETACT_CAMERA_CLONES
void shake_row(float* z_m, const float* deviate, const float* tilt, float scale, int n) noexcept {
  for (int u = 0; u < n; ++u) {
    const float z = z_m[u];
    const float mm = 1.5F - 0.5F * z + 0.3F * z * z;
    float sigma = (mm > 1.2F ? mm : 1.2F) * 1e-3F * scale;
    if (tilt != nullptr) sigma += 1e-4F * z * std::sqrt(z > 0 ? z : 0.0F) * tilt[u];
    const float shaken = z + sigma * deviate[u];
    z_m[u] = z > 0 ? shaken : z;
  }
}

namespace {

// Slope a pixel, of values two pixels aside: their mean, or the flatter one where they differ as at
// a depth edge. A side that shows nothing does not count.
float slope_of(float before, float here, float after) noexcept {
  constexpr auto kEdge = static_cast<float>(DepthNoise::kEdgeStep);
  const float l = 0.5F * (here - before), r = 0.5F * (after - here);
  if (!(before > 0) || !(after > 0)) return before > 0 ? l : after > 0 ? r : 0.0F;
  if (std::abs(r - l) > kEdge * here) return std::abs(l) < std::abs(r) ? l : r;
  return 0.5F * (l + r);
}

}  // namespace

void incidence_row(const TiltRow& row, float* cosine, int n) noexcept {
  const InverseRows& inverse = row.inverse_m;
  for (int u = 0; u < n; ++u) {
    const float here = inverse.row[u];
    cosine[u] = 1;
    if (!(here > 0)) continue;
    const auto aside = [u](const float* r) { return r != nullptr ? r[u] : 0.0F; };
    const float x = (static_cast<float>(u) - row.cx) / row.fx;
    const float a = row.fx * slope_of(u >= 2 ? inverse.row[u - 2] : 0.0F, here,
                                      u + 2 < n ? inverse.row[u + 2] : 0.0F);
    const float b = row.fy * slope_of(aside(inverse.up), here, aside(inverse.down));
    const float c = here - a * x - b * row.y;
    cosine[u] = here / std::sqrt((a * a + b * b + c * c) * (x * x + row.y * row.y + 1));
  }
}

TELETACT_CAMERA_CLONES
void invert(const float* depth_m, float* inverse_m, int n) noexcept {
  for (int i = 0; i < n; ++i) {
    const float d = depth_m[i];
    const float safe = d > 0 ? d : 1.0F;
    inverse_m[i] = d > 0 ? 1.0F / safe : 0.0F;
  }
}

TELETACT_CAMERA_CLONES
void quantise(const float* z_m, std::uint16_t* out_mm, int n, float lo_m, float hi_m) noexcept {
  for (int i = 0; i < n; ++i) {
    const float z = z_m[i];
    const bool in = (z >= lo_m) & (z <= hi_m);
    out_mm[i] =
        static_cast<std::uint16_t>(static_cast<std::int32_t>(in ? z * 1000.0F + 0.5F : 0.0F));
  }
}

}  // namespace drivers
