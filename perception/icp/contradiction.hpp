// What speaks against a pose: points that cannot be where a fit would have them.
//
// Two measures, both of a coarse image against a ray cast of the map without hint.
//   contradiction_share  live points that lie off every surface about them, in front or behind. A gate.
//   clash                points of either side where the other has seen free space: what the frame shows in front of
//                        the map's surface, and what of the map the frame looks through. What only lies behind is
//                        hidden and says nothing, so the view need not be cast from the very pose. Only patches
//                        count, no lone pixels: edges and noise make those, a thing that is not there makes a
//                        patch. It compares one fit with another.
#pragma once

#include "perception/icp/model_view.hpp"
#include "perception/icp/preprocess.hpp"

namespace perception {

// Of the live points that meet the model, the share that lies off all of the 3 x 3 surface points about the
// place it projects to by more than limit_m (times its depth beyond 1 m). 1 where none meets it.
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

// In front: nearer by limit_m + limit_per_m z than the nearest of the 3 x 3 pixels of the other side about it, of
// which at least 5 show something. In a patch: at least 5 of the 8 pixels about it are in front too. Larger images
// than kMostWidth x kMostHeight are thinned.
struct ClashRule {
  static constexpr int kMostWidth = 160, kMostHeight = 120;
  double limit_m = 0.04, limit_per_m = 0.02;
};
[[nodiscard]] Clash clash(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                          const ClashRule& rule = {}) noexcept;

}  // namespace perception
