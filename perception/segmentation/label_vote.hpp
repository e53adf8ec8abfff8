// How a label image enters the map, voxel by voxel: the second phase. A voxel has a label (0 =
// none) and a weight; every observation of it votes:
//
//   same label    weight + 1, at most kLabelWeightCap
//   another       weight - 1; at 0 the voxel takes the other label, with weight 1
//
// Background votes too, as label 0, so an object that has gone loses its voxels; a voxel votes only
// when it lies within kLabelBand_m of the observed surface. A single wrong image takes at most two
// off each weight and flips nothing that three images agreed on.
//
// Free space: a voxel seen through has nothing to be labelled; it loses kFreeStep, and at 0 its
// label. Seen through means by more than kThrough_m, or by more than the band where the pixel shows
// something else than the voxel's label: noise alone puts voxels before an object's own surface in
// and out of the band. A background vote for a labelled voxel that also lies in front of the
// surface (beyond kInFront_m) counts once more: this is what an object leaves over its support when
// it is pushed away, and makes it go in 16 frames where votes alone would need the 32 of the cap.
#pragma once

#include <cstdint>

#include "perception/geometry/image.hpp"

namespace perception {

constexpr std::uint8_t kLabelWeightCap = 32;
constexpr float kLabelBand_m = 0.02F;
constexpr float kThrough_m = 0.05F;
constexpr std::uint8_t kFreeStep = 4;
constexpr float kInFront_m = 0.01F;
constexpr std::uint8_t kMostLabel = 31;  // in a map; a greater one in an image says nothing
// In a label image: this pixel says nothing (no reading, or not segmented).
constexpr std::uint8_t kNoVote = 255;

struct LabelVoxel {
  std::uint8_t label = 0;
  std::uint8_t weight = 0;
  friend bool operator==(const LabelVoxel&, const LabelVoxel&) = default;
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

constexpr void see_through(LabelVoxel& voxel) noexcept {
  if (voxel.weight > kFreeStep) {
    voxel.weight = static_cast<std::uint8_t>(voxel.weight - kFreeStep);
  } else {
    voxel = {};
  }
}

// What integration has at hand for one voxel: the pixel it projects to, its signed distance to the
// surface measured there (positive in front), and how much farther than across the surface the band
// reaches along the ray (>= 1). `fresh` is a label that a touch has just named (0: none): it takes
// the voxels of the background at once, however long they were that.
inline void vote_at(LabelVoxel& voxel, ImageView<const std::uint8_t> labels, int u, int v,
                    float distance_m, float reach = 1.0F, std::uint8_t fresh = 0) noexcept {
  if (!labels.contains(u, v) || distance_m < -kLabelBand_m) return;
  const std::uint8_t label = labels.at(u, v);
  if (distance_m > kLabelBand_m) {
    const bool other = label != voxel.label && label <= kMostLabel;
    if (distance_m > (other ? kLabelBand_m : kThrough_m) * reach) see_through(voxel);
    return;
  }
  if (label > kMostLabel) return;
  if (label != 0 && label == fresh && voxel.label == 0) voxel.weight = 0;
  if (label == 0 && voxel.label != 0 && distance_m > kInFront_m && voxel.weight > 1) --voxel.weight;
  vote(voxel, label);
}

}  // namespace perception
