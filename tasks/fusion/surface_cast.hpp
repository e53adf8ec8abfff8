// The ray cast that the published method of touch reduces over (tasks/contract/surface_points.hpp):
// the whole map as the camera of the last claimed image sees it, one ray a pixel, no hint, the
// first crossing from + to - from the least depth on. Nothing of this exists where no scene asks
// for that method.
//
// A whole cast costs more than a period of one core. So it is made in parts, some rows a job, all
// from the pose that counted when it began; a row shows the map as it was in the job that cast it.
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
#include "tasks/contract/surface_points.hpp"

namespace tasks {

class SurfaceCast {
 public:
  // As the patch has it: a node that was observed less often than this holds no surface.
  static constexpr double kObserved = 2;

  // In `parts` calls, or fewer: whole tiles of rows.
  SurfaceCast(rt::NonRealtime&, const perception::Intrinsics& camera, int parts);

  // The camera of an image that was claimed; the next cast begins there.
  void stand_at(const perception::Pose& X_WC) noexcept { X_WC_ = X_WC; }
  [[nodiscard]] bool stands() const noexcept { return X_WC_.has_value(); }
  // The next call begins a cast: the last one is whole.
  [[nodiscard]] bool begins() const noexcept { return row_ == 0; }

  // The next rows, up to `reach_m` along the optical axis, into `out`, which has room for the
  // camera's pixels and is the same until the cast is whole; then it has count, pose and number
  // too. Nothing is cast without room or pose: stats.rays is 0, and `out` is as it was. The bytes
  // are the same for any crew.
  [[nodiscard]] perception::RaycastStats cast(const perception::TsdfMap& map, double reach_m,
                                              rt::ForkJoin& crew, SurfacePoints& out) noexcept;

 private:
  void write(int row, SurfacePoints& out) const noexcept;
  perception::Intrinsics camera_;
  int rows_;  // of a part
  perception::RaycastMaps maps_;
  std::optional<perception::Pose> X_WC_;
  perception::Pose X_cast_WC_ = perception::Pose::Identity();  // of the cast that is being made
  int row_ = 0;                                                // where its next part begins
  std::uint64_t seq_ = 0;
};

}  // namespace tasks
