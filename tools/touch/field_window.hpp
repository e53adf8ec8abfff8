// A dense distance field from a file, and the window of it that the haptic task gets: what fusion
// publishes of its map, made from a file instead.
//
// Grid: node (i, j, k) of the field is node (i, j, k) of the world grid of the patches; the caller
// shifts positions by the field's origin.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "rt/result.hpp"
#include "tools/files/npy.hpp"

namespace teletact {

struct DenseField {
  std::array<int, 3> size{};
  std::vector<float> distance;      // m, positive outside, NaN = unobserved, C order x, y, z
  std::vector<std::uint8_t> label;  // slot of the palette, the same order; empty: all 0
};

// Three dimensions, 2 to 4096 nodes each, finite or NaN.
[[nodiscard]] rt::Result<DenseField> to_field(NpyArray array, const std::string& name);

// Fills `patch` with the window of `nodes`^3 nodes round `centre` (grid frame, m): distance clamped
// to +- truncation; beyond + truncation a node is free space without a distance, NaN and everything
// outside the field is unobserved. seq and fused are the caller's.
void fill_window(const DenseField& field, const perception::Vec3& centre, double voxel_size,
                 double truncation, int nodes, perception::SurfacePatch& patch);

}  // namespace teletact
