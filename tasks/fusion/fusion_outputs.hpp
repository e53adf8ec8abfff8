// What others read of the fusion task, a writer each: patch, view, cost map, mesh. A writer decides
// whether its message is due, fills it, numbers it and says so in `out`; it makes nothing where the
// caller gave no slot.
//
// Frames: W world (= map), V eye of the view. SI. Noexcept and without allocation after
// construction.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "perception/ground/ground_map.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "perception/tsdf/patch/patch_smooth.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/clock/tick.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/camera_tracking.hpp"
#include "tasks/fusion/fusion_config.hpp"
#include "tasks/fusion/fusion_io.hpp"
#include "tasks/fusion/fusion_objects.hpp"
#include "tasks/fusion/fusion_parts.hpp"

namespace tasks {

// What the outputs of one step are made of.
struct FusionScene {
  const rt::Tick& tick;
  std::uint64_t period;  // of the task, from 1 on
  const perception::TsdfMap& map;
  const CameraState& camera;
  const CameraTracking& tracking;
  const FusionObjects* objects;  // null: switched off
  FusionStages& stages;
};

// The window round the hand.
class PatchWriter {
 public:
  // Keeps references.
  PatchWriter(rt::NonRealtime&, const FusionConfig& config, const FusionSetup& setup);

  void write(const FusionScene& scene, const HapticState& hand, FusionOut& out) noexcept;
  [[nodiscard]] const Vec3& centre_W() const noexcept { return centre_W_; }
  // Was there a hand yet that the window follows?
  [[nodiscard]] bool hand_known() const noexcept { return hand_known_; }

 private:
  const FusionConfig& config_;
  const FusionSetup& setup_;
  std::optional<perception::PatchSmoother> smoother_;  // none: the patch is the map's own field
  Vec3 centre_W_;
  bool hand_known_ = false;
  std::uint64_t seq_ = 0;
};

// What the operator sees: a ray cast with colour, objects and the mask of what moves.
//
// A whole cast costs about as much as the rest of a frame, and the budget of a job is that of the
// dearest one. So it is made in parts, some rows a job, within half of its period. All rows are
// seen from where the eye was when the cast began; a row shows the map as it was in the job that
// cast it, and `exposure` is of the first. One with labels from the map is made in one piece:
// outlines cross rows.
class ViewWriter {
 public:
  // Keeps a reference to `config`.
  ViewWriter(rt::NonRealtime&, const FusionConfig& config, const perception::Intrinsics& camera);

  // Is a view to be begun in this period?
  [[nodiscard]] bool due(bool started, std::uint64_t period, const FusionOut& out) const noexcept;
  // From the camera, or from X_WV. `has_body`: the mask shows the robot's own body.
  void write(const FusionScene& scene, const std::optional<Pose>& X_WV, bool has_body,
             FusionOut& out) noexcept;

 private:
  void begin(const FusionScene& scene, const std::optional<Pose>& X_WV, bool has_body,
             SceneView& v) noexcept;
  [[nodiscard]] perception::RaycastStats cast(const FusionScene& scene, SceneView& v) noexcept;
  void shade(int first_row, SceneView& v) const noexcept;
  void show_mask(const CameraTracking& tracking, SceneView& v) const noexcept;

  const FusionConfig& config_;
  perception::Intrinsics camera_;
  perception::RaycastMaps maps_;
  int rows_;             // of a part
  int row_ = 0;          // where the next part begins; 0: none is under way
  bool labels_ = false;  // of the cast that is under way: objects' ids come from the map
  std::uint64_t seq_ = 0;
};

// Every cost_map_period-th period, and at once when something begins to move.
class CostMapWriter {
 public:
  explicit CostMapWriter(int period) noexcept : period_(static_cast<std::uint64_t>(period)) {}

  void write(const FusionScene& scene, perception::GroundMap& ground, FusionOut& out) noexcept;

 private:
  std::uint64_t period_;
  std::uint64_t seq_ = 0, since_last_ = 0;  // periods
  bool moves_ = false;                      // the last one had something that moves
};

// The next deltas go when the last ones were taken, so none is lost; a receiver that says nothing
// for long, or has begun anew, gets all of the mesh again.
class MeshWriter {
 public:
  // Keeps a reference to `config`.
  MeshWriter(rt::NonRealtime&, const FusionConfig& config, perception::TsdfMap& map);

  // `taken`: seq of the newest delta that its receiver took.
  void write(const FusionScene& scene, std::uint64_t taken, FusionOut& out) noexcept;

 private:
  const FusionConfig& config_;
  perception::MeshSender sender_;
  std::uint64_t seq_ = 0;
  int waited_ = 0;  // for an answer, messages' time
};

}  // namespace tasks
