// Field: one scalar field made of two SurfacePatches, the old one fading into the new one.
//
//   node    both observed: (1 - s) old + s new; observed in one window only: that value; seen free
//           without a distance: + truncation, or a voxel more than a neighbour that has one; else
//           unknown
//   value   trilinear over the eight nodes of a cell, metres, positive outside. A cell with an
//           unknown node is unknown as a whole: nothing is extrapolated from half a cell.
//   frame   W (= map); both windows lie on the world's voxel grid, so they overlap node on node.
//
// A fused field is projective: |gradient| need not be 1, and nothing here assumes it.
// A Field is a view: it keeps pointers to the patches and a cache of the last eight cells, so it
// belongs to one thread. No function allocates or waits.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "perception/patch/surface_patch.hpp"

namespace tasks {

struct FieldSample {
  bool known = false;  // all eight nodes observed or seen free; otherwise the rest is zero
  double value = 0;    // m
  perception::Vec3 gradient =
      perception::Vec3::Zero();  // of the trilinear cell, at constraint scale
};

// Within one cell, lengths in voxels from its lowest node, values in voxels.
struct CellSample {
  double value = 0;
  perception::Vec3 gradient = perception::Vec3::Zero();
  // Second derivatives by yz, xz, xy; those along an axis are zero.
  perception::Vec3 bend = perception::Vec3::Zero();
};

class Field {
 public:
  // Both patches must have the same voxel size (see compatible()). `older` may be null; then
  // `newer` counts alone. `newer` null: everything is unknown.
  void set(const perception::SurfacePatch* older, const perception::SurfacePatch* newer,
           double s) noexcept;
  // Two patches may be blended: same map, same voxel size.
  [[nodiscard]] static bool compatible(const perception::SurfacePatch& a,
                                       const perception::SurfacePatch& b) noexcept {
    return a.map_id == b.map_id && a.voxel_size == b.voxel_size;
  }

  [[nodiscard]] bool empty() const noexcept { return newer_ == nullptr; }
  [[nodiscard]] double voxel() const noexcept { return voxel_; }
  [[nodiscard]] double truncation() const noexcept { return truncation_; }
  [[nodiscard]] double blend() const noexcept { return s_; }

  // Value and gradient at p_W; NaN and points outside both windows are unknown.
  [[nodiscard]] FieldSample sample(const perception::Vec3& p_W) const noexcept;
  // The polynomial of the cell whose lowest node is world grid node `at`, at `u` from that node, of
  // which the faces of the cell are part. False: the cell is unknown. Not while empty().
  [[nodiscard]] bool sample_in(const std::array<std::int32_t, 3>& at, const perception::Vec3& u,
                               CellSample& out) const noexcept;
  // Seen free: known and outside.
  [[nodiscard]] bool seen_free(const perception::Vec3& p_W) const noexcept {
    const FieldSample s = sample(p_W);
    return s.known && s.value > 0;
  }
  // Gradient by differences `half_step_vox` voxels to either side: with 1, the normal at a coarser
  // scale than the cell. Axes with an unknown side fall back to the cell's own derivative. Zero
  // where p_W is unknown.
  [[nodiscard]] perception::Vec3 smooth_gradient(const perception::Vec3& p_W,
                                                 double half_step_vox = 1.0) const noexcept;
  // Within `voxels` of the edge of the newest window, or outside it.
  [[nodiscard]] bool near_edge(const perception::Vec3& p_W, double voxels = 2.0) const noexcept;

  // Field samples taken since take_work(): the deterministic work count of a tick.
  [[nodiscard]] std::uint32_t work() const noexcept { return work_; }
  [[nodiscard]] std::uint32_t take_work() const noexcept {
    const std::uint32_t w = work_;
    work_ = 0;
    return w;
  }

 private:
  struct Cell {
    std::int32_t x = INT32_MIN, y = 0, z = 0;
    bool known = false;
    std::array<double, 8> c{};  // value = sum c[b] u^bx v^by w^bz, b = 4 bx + 2 by + bz
  };
  const Cell& cell(std::int32_t x, std::int32_t y, std::int32_t z) const noexcept;
  void fill(Cell& cell) const noexcept;
  void forget() const noexcept;

  const perception::SurfacePatch* older_ = nullptr;
  const perception::SurfacePatch* newer_ = nullptr;
  double s_ = 1, voxel_ = 1, inverse_voxel_ = 1, truncation_ = 0;
  mutable std::array<Cell, 8> cache_{};  // by the parity of x, y, z: neighbours never collide
  mutable std::uint32_t work_ = 0;
};

}  // namespace tasks
