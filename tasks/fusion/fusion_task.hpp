// Fusion, 30 Hz: depth images in, a scene that can be touched, seen and driven on out.
//
//   reads    Latest<RgbdFrame>     from the link      a frame it has not seen, or none
//            Latest<HapticState>   from tasks/haptic  where the window follows the hand
//            Latest<RobotState>    from the link      odometry: motion prior of the tracking
//            Ring<SceneEdit>       from the console   regions to forget, obstacles to draw, objects
//   writes   Latest<SurfacePatch>  to tasks/haptic    every period, even without a new image
//            Latest<SurfacePoints> to tasks/haptic    where asked for: each surface_periods-th
//            Latest<CostMap>       to tasks/planning  every cost_map_period-th period
//            Latest<CameraPose>    to prediction, haptic, console   every frame
//            Latest<SceneView>     to console         every view_period_frames-th period
//            Latest<ObjectList>    to planning, console   every frame, where switched on
//            Latest<MeshDelta>     to console         where asked for: each mesh_period_frames-th
//   budget   25 ms of the 33.3 ms period at level 0
//
// One frame: own body -> pyramid -> track -> integrate -> floor. Then, with or without a frame:
// cost map, patch copy. Once they are published: ray cast for the next track; sometimes view, mesh.
// Only claimed frames are integrated (perception/icp).
// The first usable frame defines the map: it is integrated at the initial pose.
//
// A map of another day (load_map) is where the camera is looked for: lost until it is found there.
// A region that is cleared goes in slabs, a few a job, so that a job's cost has a bound.
// Far from camera and hand the map is compressed out of its pool (TsdfMap::page).
//
// The parts, each in a file of its own: pose_prior (odometry and motion prior), camera_tracking and
// camera_search (where the camera is), map_keeper (the map, the ground, edits), fusion_body,
// fusion_objects, fusion_outputs (patch, view, cost map, mesh) and surface_cast. This file puts
// them in order.
//
// Levels (rt::Tick::level) pick a row of FusionConfig::levels: pixel step and ICP iterations. They
// are dynamic knobs; voxel size is fixed at construction.
//
// Frames: W world (= map), C camera (optical), B robot base, O odometry (starts equal to W). SI.
#pragma once

#include <cstdint>
#include <optional>

#include "perception/map_file/map_file.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "tasks/fusion/camera_search.hpp"
#include "tasks/fusion/camera_tracking.hpp"
#include "tasks/fusion/fusion_body.hpp"
#include "tasks/fusion/fusion_config.hpp"
#include "tasks/fusion/fusion_io.hpp"
#include "tasks/fusion/fusion_objects.hpp"
#include "tasks/fusion/fusion_outputs.hpp"
#include "tasks/fusion/fusion_parts.hpp"
#include "tasks/fusion/map_keeper.hpp"
#include "tasks/fusion/pose_prior.hpp"
#include "tasks/fusion/surface_cast.hpp"

namespace tasks {

inline constexpr rt::FaultId kFaultFusionLost = 201;  // F-FUS-01 tracking lost: nothing integrated
inline constexpr rt::FaultId kFaultFusionUnclaimed = 202;  // F-FUS-02 a direction is only guessed
inline constexpr rt::FaultId kFaultFusionMapFull = 203;    // F-FUS-03 block pool full: band lost
inline constexpr rt::FaultId kFaultFusionBadFrame =
    204;  // F-FUS-04 image of another size, or empty
inline constexpr rt::FaultId kFaultFusionNoJoints =
    205;  // F-FUS-05 joints missing or too old: where the body is in the image is not known

class FusionTask {
 public:
  using In = FusionIn;
  using Out = FusionOut;
  using Profile = FusionProfile;

  // Throws std::invalid_argument naming key, value, range. Allocates everything.
  FusionTask(rt::NonRealtime&, const FusionConfig& config, const FusionSetup& setup);
  FusionTask(const FusionTask&) = delete;
  FusionTask& operator=(const FusionTask&) = delete;
  ~FusionTask() = default;

  // Starts in a stored map instead of an empty one: world = that map's. Before the first step.
  // Labels of objects are of the session that wrote them and are left out. An error leaves the task
  // as it was made.
  [[nodiscard]] rt::Result<bool> load_map(rt::NonRealtime&, const perception::MapFile& file);

  // Can `box_W` be cleared? Not where it is empty, not a number, or longer than kLongestClear_m.
  static constexpr double kLongestClear_m = MapKeeper::kLongestClear_m;
  [[nodiscard]] static bool clearable(const Eigen::AlignedBox3d& box_W) noexcept {
    return MapKeeper::clearable(box_W);
  }
  // Some of the last region is still to be cleared: the next one is to wait.
  [[nodiscard]] bool clearing() const noexcept { return keeper_.clearing(); }

  // One cycle. No throw, lock, allocation or I/O.
  [[nodiscard]] rt::Health step(const rt::Tick& tick, const In& in, Out& out) noexcept {
    const rt::Health health = begin_step(tick, in, out);
    end_step(tick, in, out);
    return health;
  }
  // The same in two parts: what other tasks wait for, and what only a person sees (view, mesh) or
  // the next cycle needs. The second with the same arguments, before the next cycle.
  [[nodiscard]] rt::Health begin_step(const rt::Tick& tick, const In& in, Out& out) noexcept;
  void end_step(const rt::Tick& tick, const In& in, Out& out) noexcept;

  // Threads that take part in step(); what comes out is the same for any number. Before the first
  // step.
  void use(rt::ForkJoin& crew) noexcept {
    stages_.crew = &crew;
    tracking_.use(crew);
    keeper_.map().use(crew);
  }
  // The stages' times are then those of the way through: the caller's CPU, and where another member
  // took longer, its CPU.
  void profile(bool on) noexcept {
    stages_.profiling = on;
    keeper_.map().profile(on);
  }
  [[nodiscard]] const Profile& last_profile() const noexcept { return stages_.times; }
  [[nodiscard]] const perception::TsdfMap& map() const noexcept { return keeper_.map(); }
  [[nodiscard]] const perception::Keyframes& keyframes() const noexcept {
    return search_.keyframes();
  }
  [[nodiscard]] const Pose& camera() const noexcept { return camera_.X_WC; }  // X_WC, last believed
  // Of the last image consumed, a value of perception::PixelOf a pixel of the camera.
  [[nodiscard]] perception::ImageView<const std::uint8_t> pixel_mask() const noexcept {
    return tracking_.mask();
  }
  // Null: objects are switched off.
  [[nodiscard]] const perception::ObjectMap* objects() const noexcept {
    return objects_ ? &objects_->map() : nullptr;
  }
  [[nodiscard]] const perception::GroundMap& ground() const noexcept { return keeper_.ground(); }
  [[nodiscard]] const FusionConfig& config() const noexcept { return config_; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return camera_.frames; }
  [[nodiscard]] std::uint64_t frames_claimed() const noexcept { return camera_.frames_claimed; }
  // Half-extent a window must have so that the hand can not outrun it.
  [[nodiscard]] static double needed_half_extent(double hand_speed_m_per_s, double scale) noexcept {
    return hand_speed_m_per_s * scale * 0.1 + 0.05;
  }

 private:
  // One image.
  [[nodiscard]] rt::Health consume(const rt::Tick& tick, const In& in, Out& out) noexcept;
  [[nodiscard]] const FusionLevel& knobs_at(int level) const noexcept;
  [[nodiscard]] bool see_body(const In& in, Out& out) noexcept;
  [[nodiscard]] perception::FrameView view_of(const perception::RgbdFrame& frame) const noexcept;
  void begin_map(perception::TrackingResult& r) noexcept;
  [[nodiscard]] bool locate(const perception::RgbdFrame& frame, const FusionLevel& knobs,
                            Out& out) noexcept;
  void settle(const perception::RgbdFrame& frame, bool first, const Out& out) noexcept;
  void learn(const perception::RgbdFrame& frame, const FusionLevel& knobs, Out& out) noexcept;
  void follow_objects(const perception::RgbdFrame& frame, Out& out) noexcept;
  void page(Out& out) noexcept;
  void write_camera(Out& out) noexcept;

  void prepare_next(const FusionLevel& knobs, Out& out) noexcept;

  [[nodiscard]] FusionScene scene_of(const rt::Tick& tick) noexcept;
  void write_outputs(const rt::Tick& tick, const In& in, Out& out) noexcept;
  void write_surface(const rt::Tick& tick, Out& out) noexcept;

  FusionConfig config_;
  FusionSetup setup_;
  FusionStages stages_;
  CameraState camera_;
  std::uint64_t periods_ = 0;
  const FusionLevel* consumed_ = nullptr;  // of the image of this cycle; null: it consumed none
  PosePredictor prior_;
  CameraTracking tracking_;
  CameraSearch search_;
  MapKeeper keeper_;
  std::optional<FusionBody> body_;  // none: a robot without an arm
  std::optional<Eigen::AlignedBox3d>
      grasp_W_;                           // where a thing lay that was taken up, to be cleared
  std::optional<FusionObjects> objects_;  // none: switched off
  PatchWriter patch_;
  ViewWriter view_;
  CostMapWriter cost_map_;
  std::optional<MeshWriter> mesh_;      // none: switched off
  std::optional<SurfaceCast> surface_;  // none: nobody asks for it
};

}  // namespace tasks
