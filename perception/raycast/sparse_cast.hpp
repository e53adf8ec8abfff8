// A cast without hint at about half of its cost, for views from a new place.
//
// Every second ray of every second row is cast in full. A ray between rays that lie on one surface
// starts on that surface (RaycastOptions::hint_depth_m). A ray between rays that see nothing sees
// nothing. If they disagree, and at the last row and column, the ray is cast in full.
//
// Differs   from a full cast in things narrower than two rays, in front of one surface or of
//           nothing: they may be missed. Of 3 x 3 neighbouring rays that see one thing, at least
//           one is cast in full, and the rays round it are cast in full or agree. So patches are
//           seen whole, except for a rim where the band is narrower than a voxel.
#pragma once

#include <vector>

#include "perception/raycast/raycast.hpp"

namespace perception {

class SparseCast {
 public:
  // Room for width x height rays of the cast.
  SparseCast(rt::NonRealtime&, int width, int height);

  // As raycast(), but options.hint_depth_m, .hinted_only, .colour and .labels are ignored. Casts
  // larger than the constructed size are refused.
  RaycastStats cast(const MapView& map, const Intrinsics& camera, const Pose& X_WC,
                    const RaycastOptions& options, RaycastMaps& out) noexcept;

 private:
  void fill_hints(const Intrinsics& k, float reach_m) noexcept;
  RaycastMaps every_other_;
  std::vector<float> hint_m_;
};

}  // namespace perception
