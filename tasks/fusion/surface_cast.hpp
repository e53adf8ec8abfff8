// The ray cast that the published method of touch reduces over (tasks/graph/surface_points.hpp): the whole map as the camera
// of the last claimed image sees it, one ray a pixel, no hint, the first crossing from + to - from the least depth on.
// Nothing of this exists where no scene asks for that method.
//
// Frames: W world (= map), C camera. SI.
#pragma once

#include <optional>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"
#include "tasks/graph/surface_points.hpp"

namespace tasks {

class SurfaceCast {
 public:
  // As the patch has it: a node that was observed less often than this holds no surface.
  static constexpr double kObserved = 2;

  SurfaceCast(rt::NonRealtime&, const perception::Intrinsics& camera);

  // The camera of an image that was claimed.
  void stand_at(const perception::Pose& X_WC) noexcept { X_WC_ = X_WC; }
  [[nodiscard]] bool stands() const noexcept { return X_WC_.has_value(); }

  // From where it stands, up to `reach_m` along the optical axis, into `out`, which has room for the camera's pixels: points,
  // normals, count, pose and number. Else stats.rays is 0, and `out` is as it was. The bytes are the same for any crew.
  [[nodiscard]] perception::RaycastStats cast(const perception::TsdfMap& map, double reach_m,
                                              rt::ForkJoin& crew, SurfacePoints& out) noexcept;

 private:
  perception::Intrinsics camera_;
  perception::RaycastMaps maps_;
  std::optional<perception::Pose> X_WC_;
  std::uint64_t seq_ = 0;
};

}  // namespace tasks
