// How far two segmentations of one image agree. Labels are names only: any values, in any order.
//
//   Probabilistic Rand Index (Unnikrishnan, Pantofaru, Hebert, PAMI 2007): share of the pixel pairs
//     that both maps treat alike, over all pairs; its mean over the people of an image is the PRI.
//   Variation of Information (Meila 2005): H(A|B) + H(B|A), in bits.
//   Global Consistency Error (Martin et al., ICCV 2001): the smaller of its two directions.
//   Boundary Displacement Error (Freixenet et al., ECCV 2002): mean distance, in pixels, from the
//     boundary of one map to the nearest boundary pixel of the other; mean of both directions.
//
// A boundary pixel has a non-zero central difference of labels along a row or column (one-sided at
// the image rim); a map without any takes the rim of the image. PRI and BDE: higher, lower is
// better.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/image.hpp"

namespace perception {

using LabelView = ImageView<const std::uint16_t>;

struct SegmentationScores {
  double pri = 0;       // 0..1
  double voi_bits = 0;  // >= 0
  double gce = 0;       // 0..1
  double bde_px = 0;    // >= 0
};

// A label map with what the comparison needs of it, so that a map that is compared often pays once.
class ScoredMap {
 public:
  explicit ScoredMap(LabelView labels);

  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  [[nodiscard]] int regions() const noexcept { return static_cast<int>(sizes_.size()); }

  // Both maps must have the same size (std::invalid_argument).
  friend SegmentationScores compare(const ScoredMap& a, const ScoredMap& b);

 private:
  int width_ = 0, height_ = 0;
  std::vector<std::uint32_t> ids_;       // labels renamed to 0..regions-1
  std::vector<std::int64_t> sizes_;      // pixels of each
  std::vector<std::uint32_t> boundary_;  // pixel indices
  std::vector<float> distance_px_;       // of every pixel to the nearest boundary pixel
};

SegmentationScores compare(const ScoredMap& a, const ScoredMap& b);

// Geometric mean over images of regions / median of the people's numbers of regions.
class RegionRatio {
 public:
  void add(int regions, std::vector<int> people);
  [[nodiscard]] double value() const noexcept;

 private:
  double log_sum_ = 0;
  int images_ = 0;
};

// Squared distance of every pixel to the nearest pixel that is set, exact (Felzenszwalb and
// Huttenlocher 2012). Pixels of an image in which none is set get a value above 1e18.
[[nodiscard]] std::vector<float> squared_distance(const std::vector<std::uint8_t>& set, int width,
                                                  int height);

}  // namespace perception
