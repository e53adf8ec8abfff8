// The inner loop of the label votes: one label image into one block, by the rule of
// perception/segmentation/label_vote.hpp. Nodes, pixels and distances are those of
// voxel_update.hpp, to the last bit; the reading must be one that is fused (weight > 0) for a vote,
// any reading for free space.
#pragma once

#include <cstddef>
#include <cstdint>

#include "perception/segmentation/label_vote.hpp"
#include "perception/tsdf/kernels/voxel_update.hpp"

namespace perception {

struct LabelImage {
  const std::uint8_t* data;  // as large as the depth image
  std::ptrdiff_t stride_px;
  std::uint8_t fresh;  // label of a touch of this frame, 0: none
  float most_reach;    // most_label_reach()
};

// A voxel votes if it lies within kLabelBand_m along the ray. With voxels larger than half of that,
// hardly any would vote on a surface at a grazing angle, so there the band is longer by the pixel's
// reach. With smaller voxels it is not, since voxels behind an outline would get the label of what
// hides them. The added part votes like the end of the band.
[[nodiscard]] constexpr float most_label_reach(double voxel_m) noexcept {
  return static_cast<float>(voxel_m) > 0.55F * kLabelBand_m ? 3.0F : 1.0F;
}

// labels: 512 of the block. Returns bit n for every label n > 0 that is left in it.
std::uint32_t vote_block(const UpdateCamera& camera, const LabelImage& image, const float (&p0)[3],
                         LabelVoxel* labels) noexcept;
// The reference: one voxel after the other.
std::uint32_t vote_block_scalar(const UpdateCamera& camera, const LabelImage& image,
                                const float (&p0)[3], LabelVoxel* labels) noexcept;

[[nodiscard]] std::uint32_t labels_in(const LabelVoxel* labels) noexcept;

}  // namespace perception
