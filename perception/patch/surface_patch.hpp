// SurfacePatch: the dense window of the distance field round the hand. Of the map the haptic task
// reads this, and for the method force_shading the newest ray cast (docs/architecture.md, "the
// patch").
//
// Shape    n^3 nodes, n = 8..64, a multiple of 4; stored in 4^3 bricks so that the eight corners
//          of a trilinear sample share one or two cache lines.
// Node     i = (ix, iy, iz), 0 <= i < n, sits at world grid node (origin_node + i), i.e. at
//          p_W = (origin_node + i) * voxel_size. All windows share the world's grid, so two
//          windows overlap node on node.
// Field    int16 distance, metres = value * metres_per_unit, metres_per_unit = truncation / 32767,
//          positive outside; material byte: 0 = unobserved (weight < 2), else material slot + 1;
//          a free bit: this node was seen free or carved (free is not unknown).
// Frames   W world (= map). A fused field is projective: |grad| need not be 1.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace perception {

// Parameters of a surface material; slot 0 is the scene's default material.
struct Material {
  float stiffness_scale = 1.0F;  // multiplies the device stiffness, (0, 1]
  float friction_static = 0.0F;  // 0 = frictionless
  float friction_dynamic = 0.0F;
  float texture_amplitude_m = 0.0F;
  float texture_period_m = 0.0F;
};

struct SurfacePatch {
  static constexpr int kMaxNodes = 64;  // along an edge
  static constexpr std::size_t kMaxCells =
      static_cast<std::size_t>(kMaxNodes) * kMaxNodes * kMaxNodes;
  static constexpr int kMaxMaterials = 16;

  std::uint32_t map_id = 0;   // changes when the map is reset or another one is loaded
  std::uint64_t seq = 0;      // 0 = never published
  rt::Time fused{};           // when fusion made this window (liveness)
  rt::Time exposure{};        // exposure of the newest image in it (data age)
  double voxel_size = 0;      // m
  float metres_per_unit = 0;  // truncation / 32767
  std::array<std::int32_t, 3> origin_node{};  // world grid node of node (0,0,0)
  int nodes = 0;                              // n
  std::uint64_t checksum = 0;  // of distance and material; set by the writer when asked
  // By the newest image's motion mask the touched surface moves: the field here is no longer valid
  // for it.
  bool touched_moves = false;
  std::array<Material, kMaxMaterials> palette{};

  std::array<std::int16_t, kMaxCells> distance{};
  std::array<std::uint8_t, kMaxCells> material{};    // 0 = unobserved, else slot + 1
  std::array<std::uint64_t, kMaxCells / 64> free{};  // one bit a node, same order

  // Storage index of a node; the caller keeps 0 <= i < nodes.
  [[nodiscard]] std::size_t index(int ix, int iy, int iz) const noexcept {
    const int b = nodes / 4;
    const int brick = ((ix >> 2) * b + (iy >> 2)) * b + (iz >> 2);
    return static_cast<std::size_t>(brick) * 64U +
           static_cast<std::size_t>(((ix & 3) << 4) | ((iy & 3) << 2) | (iz & 3));
  }
  [[nodiscard]] bool free_at(std::size_t i) const noexcept {
    return ((free[i >> 6U] >> (i & 63U)) & 1U) != 0;
  }
  void set_free(std::size_t i, bool value) noexcept {
    const std::uint64_t bit = 1ULL << (i & 63U);
    if (value)
      free[i >> 6U] |= bit;
    else
      free[i >> 6U] &= ~bit;
  }
  [[nodiscard]] Vec3 node_W(int ix, int iy, int iz) const noexcept {
    return voxel_size * Vec3(origin_node[0] + ix, origin_node[1] + iy, origin_node[2] + iz);
  }
  [[nodiscard]] float truncation() const noexcept { return metres_per_unit * 32767.0F; }
  [[nodiscard]] std::size_t cells() const noexcept {
    return static_cast<std::size_t>(nodes) * static_cast<std::size_t>(nodes) *
           static_cast<std::size_t>(nodes);
  }
};

}  // namespace perception
