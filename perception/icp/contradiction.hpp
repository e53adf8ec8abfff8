// Evidence against a pose: points that can not be where that pose would place them.
//
// Two measures. Both compare a coarse depth image with a ray cast of the map without hint.
//   contradiction_share  share of live points that lie off every map surface near them, in front or
//                        behind. Used as a gate.
//   clash                points of one side that lie where the other side has seen free space: live
//                        points in front of the map's surface, and map points that the frame looks
//                        through. A point behind the other side's surface is hidden and does not
//                        count, so the view need not be cast from exactly this pose. Single pixels
//                        do not count either, since edges and noise make those; a missing object
//                        makes a patch. Used to compare one fit with another.
#pragma once

#include "perception/icp/model_view.hpp"
#include "perception/icp/preprocess.hpp"

namespace perception {

// Of the live points that project onto the model: the share that is farther than limit_m (times its
// depth beyond 1 m) from all of the 3 x 3 surface points round its projection. 1 if none projects.
[[nodiscard]] double contradiction_share(const DepthLevel& live, const ModelView& model,
                                         const Pose& X_FC, double limit_m) noexcept;

// Points compared and points in a patch, of both sides together.
struct Clash {
  int met = 0;
  int against = 0;
  [[nodiscard]] double share() const noexcept {
    return met > 0 ? static_cast<double>(against) / met : 1.0;
  }
};

// In front: nearer than the nearest of the 3 x 3 pixels of the other side round it by more than
// limit_m + limit_per_m z; at least 5 of the 9 must have a reading. In a patch: at least 5 of its 8
// neighbours are in front too. Images larger than kMostWidth x kMostHeight are subsampled.
struct ClashRule {
  static constexpr int kMostWidth = 160, kMostHeight = 120;
  double limit_m = 0.04, limit_per_m = 0.02;
};
[[nodiscard]] Clash clash(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                          const ClashRule& rule = {}) noexcept;

}  // namespace perception
