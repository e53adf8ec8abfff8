// A cast without hint for about half of its cost: what a camera would see from a new place.
//
// Every second ray of every second row is cast in full. A ray between rays that lie on one surface starts on that
// surface (RaycastOptions::hint_depth_m), one between rays that see nothing sees nothing; where they disagree, and at
// the last row and column, it is cast in full.
//
// Differs   from a full cast in things less than two rays wide, in front of one surface or before nothing: they may be
//           missed. Of 3 x 3 neighbouring rays that see one thing, one is cast in full, and all about it by itself or
//           from what they agree on: patches are seen whole, but for a rim where the band is less than a voxel wide.
#pragma once

#include <vector>

#include "perception/raycast/raycast.hpp"

namespace perception {

class SparseCast {
 public:
  // Room for width x height rays of the cast.
  SparseCast(rt::NonRealtime&, int width, int height);

  // As raycast(); options.hint_depth_m, .hinted_only, .colour and .labels are not looked at. Larger casts than there
  // is room for are refused.
  RaycastStats cast(const MapView& map, const Intrinsics& camera, const Pose& X_WC,
                    const RaycastOptions& options, RaycastMaps& out) noexcept;

 private:
  void fill_hints(const Intrinsics& k, float reach_m) noexcept;
  RaycastMaps every_other_;
  std::vector<float> hint_m_;
};

}  // namespace perception
