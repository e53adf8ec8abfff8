// The window of the map that the haptic task reads, copied out of the sparse map.
#pragma once

#include <cstdint>
#include <span>

#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/blocks/map_view.hpp"

namespace perception {

// First world grid node of a window of `nodes` (a multiple of 4) about a point: the centre lies
// within two voxels of the window's middle. Snapped to multiples of four nodes, so that a brick of
// the patch is a piece of one block; windows therefore overlap node on node.
[[nodiscard]] std::array<std::int32_t, 3> patch_origin(const Vec3& centre_W, int nodes,
                                                       double voxel_size) noexcept;

// Fills geometry (map id, voxel size, metres per unit, origin, nodes), distance, material and free
// bits; leaves seq, times, palette and checksum alone. Observed = weight >= 2 observations; an
// unobserved node has distance 0 and material 0. Material of an observed node = 1 +
// slot_of_label[label] (slot 0 everywhere when the table is empty, else 256 entries below
// SurfacePatch::kMaxMaterials). Free: an observed node by its sign (distance > 0), any other by
// what the map saw. nodes: 8..64, a multiple of 4; anything else, or a centre that is not finite,
// returns false and leaves `out` as it was.
bool copy_patch(const MapView& map, const Vec3& centre_W, int nodes, SurfacePatch& out,
                std::span<const std::uint8_t> slot_of_label = {}) noexcept;

// Of origin, size, distance, material and free bits.
[[nodiscard]] std::uint64_t patch_checksum(const SurfacePatch& patch) noexcept;

}  // namespace perception
