// Is it the scene itself that moves, and the camera's motion is not what it seems? Where the map
// began with a thing that fills the image, the thing's motion may pass for the camera's. Two signs,
// while the map is young:
//
//   behind   what does not fit the consensus lies behind what does: things are before the place
//   holes    more and more of the image has no surface in the map, as what it saw there is carved
//            and what it sees lies elsewhere in every image. A real camera's young map has
//            holes, too, but they close.
//
// Noexcept, no allocation.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "perception/motion/consensus.hpp"
#include "perception/motion/motion_evidence.hpp"
#include "perception/motion/watched_image.hpp"
#include "perception/tsdf/blocks/map_view.hpp"

namespace perception::motion {

// What of an image fits the consensus: [0], and what does not: [1]. Every eighth pixel.
struct FitShares {
  std::array<double, 2> pixels{}, depth_m{};  // depth_m: sum
  double nowhere = 0;                         // pixels of which the map should show something
};

// A pixel does not fit where it is in `mask`, or of a cell that meets no surface or misses the one
// that it meets.
[[nodiscard]] FitShares fit_shares(const MapView& map, const DepthLevel& live, const Pose& X_WC,
                                   const WatchedImage& image, const Consensus& consensus,
                                   const MotionEvidence& evidence,
                                   const std::vector<std::uint8_t>& mask) noexcept;

class PlaceDoubt {
 public:
  // Once an image while the map is young. `known`: claimed frames of the map; `masked_share`: of
  // the last image, that moved. True: it may be the place that moves.
  [[nodiscard]] bool doubts(const FitShares& shares, int known, double masked_share) noexcept;

 private:
  double least_holes_ = 0;  // share of the image, while the map is young
  double holes_ = 0;        // of the last image
  double own_holes_ = 0;    // that the map has without a thing that moves
  int in_doubt_ = 0;        // frames yet
  int grown_ago_ = 1000;    // frames since an image with more holes
  bool sure_ = false;       // by a second one soon after
};

}  // namespace perception::motion
