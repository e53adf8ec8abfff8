// Reading a SurfacePatch between its nodes: trilinear value, gradient, and which corners are
// observed. Nothing is extrapolated: outside the window there is no cell, and what to do with a
// cell that has an unobserved corner is the caller's choice (its mask says which). Header only; no
// state, no allocation.
#pragma once

#include <cmath>
#include <cstdint>

#include "perception/patch/surface_patch.hpp"

namespace perception {

// The cell of eight nodes round a point. Corner c: bit 2 = x+1, bit 1 = y+1, bit 0 = z+1.
struct PatchCell {
  bool inside = false;        // the point lies within the window; otherwise nothing else is set
  std::uint8_t observed = 0;  // bit c: corner c has a distance
  std::uint8_t free = 0;      // bit c: corner c was seen free
  std::array<float, 8> d{};   // m; 0 where not observed
  std::array<std::uint8_t, 8> material{};  // 0 or slot + 1
  std::array<float, 3> f{};                // position in the cell, [0, 1]

  [[nodiscard]] bool complete() const noexcept { return observed == 0xff; }
  // m, of the trilinear interpolant.
  [[nodiscard]] double value() const noexcept {
    double v = 0;
    for (unsigned c = 0; c < 8; ++c) v += weight(c) * static_cast<double>(d[c]);
    return v;
  }
  // Exact gradient of the interpolant, m/m.
  [[nodiscard]] Vec3 gradient(double voxel_size) const noexcept {
    Vec3 g = Vec3::Zero();
    for (unsigned c = 0; c < 8; ++c) {
      const double wx = side(c, 2), wy = side(c, 1), wz = side(c, 0), v = static_cast<double>(d[c]);
      g.x() += ((c & 4U) != 0 ? v : -v) * wy * wz;
      g.y() += ((c & 2U) != 0 ? v : -v) * wx * wz;
      g.z() += ((c & 1U) != 0 ? v : -v) * wx * wy;
    }
    return g / voxel_size;
  }
  // Share of corner c at the point.
  [[nodiscard]] double weight(unsigned c) const noexcept {
    return side(c, 2) * side(c, 1) * side(c, 0);
  }

 private:
  [[nodiscard]] double side(unsigned c, unsigned bit) const noexcept {
    const auto t = static_cast<double>(f[2 - bit]);
    return ((c >> bit) & 1U) != 0 ? t : 1.0 - t;
  }
};

// p_W lies between the first and the last node of the window, both included. False for NaN and for
// a patch that was never filled.
[[nodiscard]] inline bool inside_window(const SurfacePatch& patch, const Vec3& p_W) noexcept {
  if (patch.nodes < 2) return false;
  for (int a = 0; a < 3; ++a) {
    const double x = p_W(a) / patch.voxel_size - patch.origin_node[static_cast<std::size_t>(a)];
    if (!(x >= 0 && x <= patch.nodes - 1)) return false;
  }
  return true;
}

[[nodiscard]] inline PatchCell patch_cell(const SurfacePatch& patch, const Vec3& p_W) noexcept {
  PatchCell cell;
  if (patch.nodes < 2) return cell;
  std::array<int, 3> i{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = p_W(static_cast<Eigen::Index>(a)) / patch.voxel_size - patch.origin_node[a];
    if (!(x >= 0 && x <= patch.nodes - 1)) return cell;
    i[a] = static_cast<int>(x);
    if (i[a] == patch.nodes - 1) --i[a];  // the last node belongs to the last cell
    cell.f[a] = static_cast<float>(x - i[a]);
  }
  cell.inside = true;
  for (unsigned c = 0; c < 8; ++c) {
    const std::size_t n =
        patch.index(i[0] + static_cast<int>(c >> 2U), i[1] + static_cast<int>((c >> 1U) & 1U),
                    i[2] + static_cast<int>(c & 1U));
    const std::uint8_t m = patch.material[n];
    cell.material[c] = m;
    cell.observed = static_cast<std::uint8_t>(cell.observed | (static_cast<unsigned>(m != 0) << c));
    cell.free =
        static_cast<std::uint8_t>(cell.free | (static_cast<unsigned>(patch.free_at(n)) << c));
    cell.d[c] = m != 0 ? static_cast<float>(patch.distance[n]) * patch.metres_per_unit : 0.0F;
  }
  return cell;
}

// Central difference of the trilinear value over `step` metres to either side. False, and `out` as
// it was, when one of the six points has no complete cell.
[[nodiscard]] inline bool patch_gradient(const SurfacePatch& patch, const Vec3& p_W, double step,
                                         Vec3& out) noexcept {
  Vec3 g;
  for (int a = 0; a < 3; ++a) {
    const PatchCell lo = patch_cell(patch, p_W - step * Vec3::Unit(a));
    const PatchCell hi = patch_cell(patch, p_W + step * Vec3::Unit(a));
    if (!lo.complete() || !hi.complete()) return false;
    g(a) = (hi.value() - lo.value()) / (2 * step);
  }
  out = g;
  return true;
}

}  // namespace perception
