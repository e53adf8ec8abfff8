// The scene that the fusion task keeps: the map of surfaces, what of it the next image is tracked
// against, the ground, and what holds the map in its place. Also the operator's edits of it.
//
// A region that is cleared goes in slabs, a few a job, so that a job's cost has a bound. Far from
// camera and hand the map is compressed out of its pool (TsdfMap::page).
//
// Frames: W world (= map), C camera. SI. Noexcept and without allocation after construction.
#pragma once

#include <span>

#include "perception/ground/ground_map.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/camera_tracking.hpp"
#include "tasks/fusion/fusion_config.hpp"
#include "tasks/fusion/fusion_io.hpp"
#include "tasks/fusion/fusion_parts.hpp"
#include "tasks/fusion/map_anchor.hpp"

namespace tasks {

class MapKeeper {
 public:
  static constexpr double kLongestClear_m = 10;

  MapKeeper(rt::NonRealtime&, const FusionConfig& config, const FusionSetup& setup,
            FusionStages& stages);

  [[nodiscard]] perception::TsdfMap& map() noexcept { return map_; }
  [[nodiscard]] const perception::TsdfMap& map() const noexcept { return map_; }
  [[nodiscard]] perception::GroundMap& ground() noexcept { return ground_; }
  [[nodiscard]] const perception::GroundMap& ground() const noexcept { return ground_; }
  // What the next image is tracked against.
  [[nodiscard]] perception::ModelView model() const noexcept {
    return {model_.data(), model_.intrinsics, model_.X_WC};
  }
  // The same camera pose with the map's motion taken back (map_anchor.hpp).
  [[nodiscard]] Pose held(const Pose& X_WC) const noexcept { return anchor_.held(X_WC); }

  // Fuses an image of camera.exposure, taken at camera.X_WC; sets out.integrated and camera.fused.
  void learn(const perception::FrameView& seen, int allocate_step, CameraState& camera,
             FusionOut& out) noexcept;
  // Casts what the next image is tracked against.
  void cast_model(const CameraTracking& tracking, const Pose& X_WC, int pixel_step,
                  FusionOut& out) noexcept;
  // Looks where the map is, what was just fused included; `lost`: nobody knows where the camera is.
  void keep_in_place(const CameraTracking& tracking, const Pose& X_WC, bool lost,
                     FusionOut& out) noexcept;
  // What stands, if the map `learns` from this image, then what moves.
  void see_ground(const CameraTracking& tracking, const CameraState& camera,
                  const perception::TrackingResult& r, bool learns) noexcept;
  // What is far from all of these leaves the pool, what they come near to returns.
  void page(std::span<const Vec3> anchors_W, FusionOut& out) noexcept;

  // Can `box_W` be cleared? Not where it is empty, not a number, or longer than kLongestClear_m.
  [[nodiscard]] static bool clearable(const Eigen::AlignedBox3d& box_W) noexcept;
  // Begins to clear a region, in place of what is left of the last one. Nothing where it is not
  // clearable.
  void clear(const Eigen::AlignedBox3d& box_W) noexcept;
  // Some of the last region is still to be cleared: the next one is to wait.
  [[nodiscard]] bool clearing() const noexcept;
  // Clears the next slab.
  void clear_some(FusionOut& out) noexcept;

 private:
  const FusionConfig& config_;
  perception::Intrinsics camera_;
  FusionStages& stages_;
  perception::TsdfMap map_;
  MapAnchor anchor_;
  perception::GroundMap ground_;
  perception::RaycastMaps model_;
  Eigen::AlignedBox3d to_clear_W_;  // empty: nothing
};

}  // namespace tasks
