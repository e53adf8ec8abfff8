// How a label image enters the map, voxel by voxel: the second phase. A voxel has a label (0 = none)
// and a weight; every observation of it votes:
//
//   same label    weight + 1, at most kLabelWeightCap
//   another       weight - 1; at 0 the voxel takes the other label, with weight 1
//
// Background votes too, as label 0, so an object that has gone loses its voxels; a voxel votes only
// when it lies within kLabelBand_m of the observed surface. A single wrong image takes at most one off
// each weight and flips nothing that two images agreed on.
#pragma once

#include <cstdint>

#include "perception/geometry/image.hpp"

namespace perception {

constexpr std::uint8_t kLabelWeightCap = 32;
constexpr float kLabelBand_m = 0.02F;
// In a label image: this pixel says nothing (no reading, or not segmented).
constexpr std::uint8_t kNoVote = 255;

struct LabelVoxel {
  std::uint8_t label = 0;
  std::uint8_t weight = 0;
};

constexpr void vote(LabelVoxel& voxel, std::uint8_t label) noexcept {
  if (voxel.weight == 0) {
    voxel = {label, 1};
  } else if (voxel.label == label) {
    if (voxel.weight < kLabelWeightCap) ++voxel.weight;
  } else if (--voxel.weight == 0) {
    voxel = {label, 1};
  }
}

// What integration has at hand for one voxel: the pixel it projects to, and its signed distance to the
// surface measured there (positive in front).
inline void vote_at(LabelVoxel& voxel, ImageView<const std::uint8_t> labels, int u, int v,
                    float distance_m) noexcept {
  if (!labels.contains(u, v) || distance_m > kLabelBand_m || distance_m < -kLabelBand_m) return;
  const std::uint8_t label = labels.at(u, v);
  if (label != kNoVote) vote(voxel, label);
}

}  // namespace perception
