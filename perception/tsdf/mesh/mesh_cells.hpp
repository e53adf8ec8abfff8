// The cells of a block as marching cubes sees them: which have a surface, and where it cuts their
// edges. Shared by the mesh of a whole map and by the deltas of a changing one. No allocation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "perception/geometry/no_colour.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/blocks/map_view.hpp"
#include "perception/tsdf/mesh/marching_cubes.hpp"

namespace perception {

// A cell belongs to the block of its lowest corner; its others may be in the blocks one to the x,
// y, z.
class MeshCells {
 public:
  // See MeshOptions. A reader of the map inside: use it only between two changes of the map.
  MeshCells(const MapView& map, double min_weight, double max_edge_jump,
            bool needs_readings) noexcept
      : map_(map),
        reader_(map, min_weight),
        max_jump_(static_cast<float>(max_edge_jump * MapLayout::kDistanceOne)),
        least_readings_(
            static_cast<std::uint32_t>(std::clamp(std::lround(2 * min_weight) - 1, 1L, 15L))),
        needs_readings_(needs_readings) {}

  // Something was fused in colour, so readings are counted.
  [[nodiscard]] static bool coloured(const MapView& map, std::int32_t block) noexcept {
    const std::uint32_t* c = map.block_colours(block);
    return std::any_of(c, c + MapLayout::kBlockVoxels, [](std::uint32_t v) { return v != 0; });
  }

  // fn(i, j, k, cell, case) for every cell of the block with triangles, in order.
  template <class Fn>
  void cut(std::int32_t block, BlockCoord at, Fn&& fn) {
    block_ = block;
    at_ = at;
    for (int n = 0; n < MapLayout::kBlockVoxels; ++n)
      cut_cell(at.x * 8 + (n >> 6), at.y * 8 + ((n >> 3) & 7), at.z * 8 + (n & 7), fn);
  }

  [[nodiscard]] MapReader& reader() noexcept { return reader_; }

  // Where the surface cuts an edge of a cell: its lower node, its axis, and the share of it below.
  struct Crossing {
    int x, y, z, axis;
    float share;
    [[nodiscard]] Vec3 position(double voxel) const {
      Vec3 p(x, y, z);
      p(axis) += static_cast<double>(share);
      return p * voxel;
    }
  };
  [[nodiscard]] static Crossing crossing(int i, int j, int k, const MapReader::Cell& c,
                                         std::uint8_t edge) noexcept {
    const marching_cubes::Edge e = marching_cubes::kEdges[edge];
    const float a = c.corner(e.corner), b = c.corner(e.corner | marching_cubes::axis_bit(e.axis));
    return {i + (e.corner >> 2), j + ((e.corner >> 1) & 1), k + (e.corner & 1), e.axis,
            a / (a - b)};
  }

 private:
  template <class Fn>
  void cut_cell(int i, int j, int k, Fn& fn) {
    const MapReader::Cell c = reader_.cell(i, j, k, 0.0F, 0.0F, 0.0F);
    if (!c.valid) return;
    unsigned inside = 0;
    for (unsigned n = 0; n < 8; ++n)
      inside |= static_cast<unsigned>(c.corner(static_cast<int>(n)) <= 0) << n;
    const marching_cubes::Case& m = marching_cubes::kCases[inside];
    if (m.triangles == 0) return;
    for (const marching_cubes::Edge& e : marching_cubes::kEdges) {
      const float a = c.corner(e.corner), b = c.corner(e.corner | marching_cubes::axis_bit(e.axis));
      if ((a <= 0) == (b <= 0)) continue;
      if (std::fabs(a - b) > max_jump_) return;
      if (needs_readings_ &&
          readings(i, j, k, e.corner) +
                  readings(i, j, k, e.corner | marching_cubes::axis_bit(e.axis)) <
              least_readings_)
        return;
    }
    fn(i, j, k, c, m);
  }

  // Readings that ended near this corner of the cell, as far as they are counted.
  [[nodiscard]] std::uint32_t readings(int i, int j, int k, int corner) const noexcept {
    const int x = i + (corner >> 2), y = j + ((corner >> 1) & 1), z = k + (corner & 1);
    const BlockCoord b{x >> 3, y >> 3, z >> 3};
    const std::int32_t block = b == at_ ? block_ : map_.find_block(b);
    return block == MapLayout::kNoBlock
               ? 0U
               : readings_of(map_.block_colours(block)[MapLayout::in_block(x, y, z)]);
  }

  MapView map_;
  MapReader reader_;
  float max_jump_;
  std::uint32_t least_readings_;
  bool needs_readings_;
  std::int32_t block_ = MapLayout::kNoBlock;  // whose cells are looked at
  BlockCoord at_;
};

}  // namespace perception
