// Fusion, 30 Hz: depth images in, a scene that can be touched, seen and driven on out.
//
//   reads    Latest<RgbdFrame>     from the link      a frame it has not seen, or none
//            Latest<HapticState>   from tasks/haptic  where the window follows the hand
//            Latest<RobotState>    from the link      odometry: motion prior of the tracking
//            Ring<SceneEdit>       from the console   regions to forget, obstacles drawn by the operator
//   writes   Latest<SurfacePatch>  to tasks/haptic    every period, even without a new image
//            Latest<SurfacePoints> to tasks/haptic    every surface_periods-th period at most, where asked for
//            Latest<CostMap>       to tasks/planning  every cost_map_period-th period
//            Latest<CameraPose>    to prediction, console   every frame
//            Latest<SceneView>     to console         every view_period_frames-th period
//            Latest<ObjectList>    to planning, console   every frame, where objects are switched on
//            Latest<MeshDelta>     to console         every mesh_period_frames-th period at most, where asked for
//   budget   25 ms of the 33.3 ms period at level 0
//
// One frame: filter -> pyramid -> track -> integrate -> ray cast for the next track -> cost map;
// then always: patch copy; sometimes: view. Only claimed frames are integrated (perception/icp).
// The first usable frame defines the map: it is integrated at the initial pose.
//
// A map of another day (load_map) is where the camera is looked for: lost until it is found there.
// A region that is cleared goes in slabs, a few a job, so that a job's cost has a bound.
// Far from camera and hand the map is compressed out of its pool (TsdfMap::page).
//
// Levels (rt::Tick::level) pick a row of FusionConfig::levels: pixel step and ICP iterations. They are
// dynamic knobs; voxel size is fixed at construction.
//
// Frames: W world (= map), C camera (optical), B robot base, O odometry (starts equal to W). SI.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/ground/ground_map.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/map_file/map_file.hpp"
#include "perception/motion/motion_mask.hpp"
#include "perception/motion/motion_watch.hpp"
#include "perception/objects/object_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/relocalisation/relocaliser.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "perception/tsdf/patch/patch_smooth.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/tick.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/object_list.hpp"
#include "tasks/contract/scene_view.hpp"
#include "tasks/fusion/fusion_body.hpp"
#include "tasks/fusion/map_anchor.hpp"
#include "tasks/fusion/odometry_chain.hpp"
#include "tasks/fusion/surface_cast.hpp"

namespace tasks {

inline constexpr rt::FaultId kFaultFusionLost = 201;  // F-FUS-01 tracking lost: nothing integrated
inline constexpr rt::FaultId kFaultFusionUnclaimed = 202;  // F-FUS-02 a direction is only guessed
inline constexpr rt::FaultId kFaultFusionMapFull = 203;    // F-FUS-03 block pool full: band lost
inline constexpr rt::FaultId kFaultFusionBadFrame =
    204;  // F-FUS-04 image of another size, or empty
inline constexpr rt::FaultId kFaultFusionNoJoints =
    205;  // F-FUS-05 joints missing or too old: where the body is in the image is not known

struct FusionLevel {
  int pixel_step = 1;                       // of tracking and of its ray cast: 1, 2, 4
  int allocate_step = 1;                    // rays that allocate blocks
  std::array<int, 3> iterations{4, 5, 15};  // fine to coarse
};

// What the palette says of an object's slot; the fields of perception::Material.
struct ObjectMaterial {
  double stiffness_scale = 1, friction_static = 0, friction_dynamic = 0;
  double texture_amplitude_m = 0, texture_period_m = 0;
  void describe(config::Section& s, const char* of);
};
// Of one object: [[fusion.objects.material]].
struct MaterialOfObject {
  int id = 1;  // the objects are numbered as they are marked
  ObjectMaterial material;
};

struct FusionConfig {
  static constexpr int kMaxLevels = 3;
  perception::TsdfConfig tsdf;
  perception::TrackerConfig tracker;
  perception::MotionConfig motion;
  perception::RelocaliserConfig relocaliser;
  perception::GroundConfig ground;
  perception::ObjectsConfig objects;
  BodyConfig body;
  ObjectMaterial object_material;                 // of every object
  std::deque<MaterialOfObject> object_materials;  // of single ones, instead
  int patch_nodes = 64;
  double window_lead_periods = 2;  // patch centre = hand + velocity x this many periods
  bool patch_checksums = true;     // fill SurfacePatch::checksum
  // Voxels: the field round the hand is smoothed over so many (perception/tsdf/patch/patch_smooth.hpp); 0: as it is in the map.
  double patch_smooth = perception::SmoothOptions{}.radius;
  int view_period_frames = 3;  // 0: no view
  int view_step = 2;           // pixels of the camera per pixel of the view, 1..8
  double view_min_weight = 1;  // observations that what it shows has at least
  int cost_map_period = 3;     // periods; published whether it changed or not
  int mesh_blocks = 0;         // blocks cut for a message of mesh deltas; 0: none are made
  int mesh_period_frames = 3;  // periods between two of them
  int surface_periods = 12;    // jobs that the ray cast for the published method is made in
  std::string map;             // stored map to begin with (load_map); empty: none
  // Odometry: error growth since the last frame the scene constrained fully.
  double odometry_translation_share = 0.02;  // of the way
  double odometry_rotation_share = 0.02;     // of the turn
  double odometry_deg_per_m = 0.5;
  double velocity_decay = 0.8;  // of the constant-velocity prior a frame that is not claimed
  int blank_frames = 3;         // images without a reading that the prior may bridge
  // Farther from the prior in one frame: claimed only where no other place looks alike.
  double leap_translation_m = 0.05, leap_rotation_deg = 4;
  int level_count = 3;
  std::array<FusionLevel, kMaxLevels> levels{
      FusionLevel{1, 2, {4, 5, 15}}, FusionLevel{2, 2, {4, 5, 15}}, FusionLevel{4, 4, {4, 5, 15}}};
  void describe(config::Section& s);
  void describe_objects(config::Section& s);
};

// What is known when the task is built.
struct FusionSetup {
  perception::Intrinsics camera{};  // of the depth images
  Pose X_WC0 = Pose::Identity();    // camera at the first frame; robots: X_WB0 * X_BC
  Pose X_BC = Pose::Identity();     // camera mount; recordings: identity
  // The robot that carries the camera, where it has an arm that may be in view; null: none, and no frame's joints
  // are looked at.
  std::shared_ptr<const perception::RobotDescription> robot;
  perception::GroundPrior ground;  // robots: up = z, camera height, start of the base
  std::array<perception::Material, perception::SurfacePatch::kMaxMaterials> palette{};
  rt::Nanos period{33333333};
  bool ray_cast = false;  // somebody touches by the published method: it gets its ray cast
};

// Throws std::invalid_argument naming key, value, range.
void require_valid(const FusionConfig& config, const FusionSetup& setup);

// X_OB at an instant, with the velocity there.
struct OdometryPrior {
  rt::Time taken{};
  Pose X_OB = Pose::Identity();
  Vec3 v_OB_B = Vec3::Zero(), w_OB_B = Vec3::Zero();  // m/s, rad/s, in B
};

class FusionTask {
 public:
  struct In {
    const perception::RgbdFrame* frame = nullptr;  // nullptr: there never was one
    bool frame_fresh = false;                      // not handed in before
    HapticState hand;
    std::optional<OdometryPrior> odometry;                           // newest one
    std::span<const perception::VirtualObstacle> virtual_obstacles;  // drawn by the operator
    bool virtual_obstacles_changed = false;
    std::optional<Eigen::AlignedBox3d> clear_W;  // to forget, in addition to what is being cleared
    std::uint64_t mesh_taken = 0;                // seq of the newest delta that its receiver took
    std::optional<Pose> X_WV;                    // eye of the view; none: the camera
    std::optional<perception::HeldObject> held;  // from grasp to release
  };
  struct Out {
    perception::SurfacePatch* patch = nullptr;  // a nullptr output is not made
    SurfacePoints* surface = nullptr;  // of the camera's size; made only where the setup asks
    bool surface_written = false;
    SceneView* view = nullptr;
    perception::CostMap* cost_map = nullptr;
    ObjectList* objects = nullptr;
    bool objects_written = false;
    perception::MeshDelta* mesh = nullptr;
    bool mesh_written = false;
    CameraPose camera;
    bool patch_written = false, view_written = false, cost_map_written = false;
    bool camera_written = false;  // true when a frame was consumed
    bool integrated = false;
    int body_pixels = 0;                  // of the consumed frame
    perception::TrackingResult tracking;  // of the consumed frame
    perception::MotionResult motion;      // of the consumed frame
    perception::IntegrateStats integration;
    perception::PageStats paging;
    perception::ObjectStats segmentation;
    std::uint64_t work = 0;       // deterministic count of the whole step
    std::uint64_t work_view = 0;  // of it, for the view
  };
  // Thread CPU of the stages of the last step, ns; filled only while profile(true). Off in the tasks.
  struct Profile {
    std::int64_t prepare = 0, track = 0, integrate = 0, raycast = 0, ground = 0, cost_map = 0,
                 patch = 0, surface = 0, view = 0, objects = 0, mesh = 0, clear = 0;
    perception::IntegrateTimes integrate_parts;  // of integrate
  };

  // Throws std::invalid_argument naming key, value, range. Allocates everything.
  FusionTask(rt::NonRealtime&, const FusionConfig& config, const FusionSetup& setup);
  ~FusionTask();

  // Starts in a stored map instead of an empty one: world = that map's. Before the first step. Labels of
  // objects are of the session that wrote them and are left out. An error leaves the task as it was made.
  [[nodiscard]] rt::Result<bool> load_map(rt::NonRealtime&, const perception::MapFile& file);

  // Can `box_W` be cleared? Not where it is empty, not a number, or longer than kLongestClear_m.
  static constexpr double kLongestClear_m = 10;
  [[nodiscard]] static bool clearable(const Eigen::AlignedBox3d& box_W) noexcept;
  // Some of the last region is still to be cleared: the next one is to wait.
  [[nodiscard]] bool clearing() const noexcept { return !to_clear_W_.isEmpty(); }

  // One cycle. No throw, lock, allocation or I/O.
  [[nodiscard]] rt::Health step(const rt::Tick& tick, const In& in, Out& out) noexcept;

  // Threads that take part in step(); what comes out is the same for any number. Before the first step.
  void use(rt::ForkJoin& crew) noexcept {
    crew_ = &crew;
    tracker_.use(crew);
    map_.use(crew);
  }
  // The stages' times are then those of the way through: the caller's CPU, and where another member took longer,
  // its CPU.
  void profile(bool on) noexcept {
    profiling_ = on;
    map_.profile(on);
  }
  [[nodiscard]] const Profile& last_profile() const noexcept { return profile_; }
  [[nodiscard]] const perception::TsdfMap& map() const noexcept { return map_; }
  [[nodiscard]] const perception::Keyframes& keyframes() const noexcept {
    return relocaliser_.keyframes();
  }
  [[nodiscard]] const Pose& camera() const noexcept { return X_WC_; }  // X_WC, last believed
  // Of the last image consumed, a value of perception::PixelOf a pixel of the camera.
  [[nodiscard]] perception::ImageView<const std::uint8_t> pixel_mask() const noexcept {
    return {mask_.data(), setup_.camera.width, setup_.camera.height, setup_.camera.width};
  }
  [[nodiscard]] const perception::ObjectMap* objects() const noexcept { return objects_.get(); }
  [[nodiscard]] const perception::GroundMap& ground() const noexcept { return ground_; }
  [[nodiscard]] const FusionConfig& config() const noexcept { return config_; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }
  [[nodiscard]] std::uint64_t frames_claimed() const noexcept { return frames_claimed_; }
  // Half-extent a window must have so that the hand can not outrun it (definitions: patch).
  [[nodiscard]] static double needed_half_extent(double hand_speed_m_per_s, double scale) noexcept {
    return hand_speed_m_per_s * scale * 0.1 + 0.05;
  }

 private:
  [[nodiscard]] perception::MotionPrior predict(rt::Time exposure) noexcept;
  void remember_odometry(const std::optional<OdometryPrior>& odometry) noexcept;
  [[nodiscard]] std::optional<Pose> odometry_at(rt::Time t) const noexcept;
  [[nodiscard]] rt::Health consume(const rt::Tick& tick, const perception::RgbdFrame& frame,
                                   Out& out) noexcept;
  void recover(const perception::RgbdFrame& frame, const perception::MotionPrior& prior,
               const FusionLevel& knobs, perception::TrackingResult& r) noexcept;
  void track(const perception::MotionPrior& prior, const FusionLevel& knobs, Out& out) noexcept;
  [[nodiscard]] bool moved_on() const noexcept;
  [[nodiscard]] bool look(const Pose& X_WC) noexcept;
  void doubt_leap(const perception::RgbdFrame& frame, const perception::MotionPrior& prior,
                  perception::TrackingResult& r) noexcept;
  void watch_for_loss(const perception::TrackingResult& r) noexcept;
  [[nodiscard]] perception::ModelView model() const noexcept {
    return {model_.data(), model_.intrinsics, model_.X_WC};
  }
  // fusion_body.cpp
  [[nodiscard]] bool see_body(const perception::RgbdFrame& frame, Out& out) noexcept;
  void show_body() noexcept;
  [[nodiscard]] perception::FrameView view_of(const perception::RgbdFrame& frame) const noexcept;
  void settle_motion(const perception::TrackingResult& r, rt::Time exposure, bool first) noexcept;
  void cast_model(int pixel_step, Out& out) noexcept;
  void keep_map_in_place(Out& out) noexcept;
  void page(Out& out) noexcept;
  // fusion_objects.cpp
  void set_up_objects(rt::NonRealtime& nrt);
  void remember_mark(const HapticState& hand) noexcept;
  void follow_objects(const perception::RgbdFrame& frame, bool integrated, Out& out) noexcept;
  void answer_mark(perception::TouchAnswer answer, std::uint8_t id) noexcept;
  void write_objects(Out& out) noexcept;

  void write_patch(const rt::Tick& tick, const HapticState& hand, Out& out) noexcept;
  [[nodiscard]] bool touched_moves(const HapticState& hand) const noexcept;
  void write_surface(const rt::Tick& tick, Out& out) noexcept;
  [[nodiscard]] bool view_due(const Out& out) const noexcept;
  void write_view(const rt::Tick& tick, const std::optional<Pose>& X_WV, Out& out) noexcept;
  void show_mask(bool own_eye, SceneView& v) const noexcept;
  void write_cost_map(const rt::Tick& tick, Out& out) noexcept;
  void see_ground(const perception::TrackingResult& r, bool learns) noexcept;
  void clear_some(Out& out) noexcept;
  void write_mesh(const rt::Tick& tick, std::uint64_t taken, Out& out) noexcept;

  FusionConfig config_;
  FusionSetup setup_;
  perception::TsdfMap map_;
  perception::Tracker tracker_;
  perception::MotionWatch watch_;
  perception::Relocaliser relocaliser_;
  MapAnchor anchor_;
  perception::GroundMap ground_;
  perception::RaycastMaps model_, view_maps_;
  std::vector<std::uint8_t> mask_;    // of perception::PixelOf
  bool masked_ = false;               // not all of it is kPlace
  std::unique_ptr<FusionBody> body_;  // null: a robot without an arm
  std::optional<perception::HeldObject> held_;
  std::optional<Eigen::AlignedBox3d> grasp_W_;     // where a thing lay, to be cleared
  perception::Image<std::uint8_t> objects_shown_;  // pixels of the view; of this period's frame:
  bool objects_drawn_ = false;
  std::unique_ptr<perception::ObjectMap> objects_;       // null: switched off
  std::unique_ptr<perception::PatchSmoother> smoother_;  // null: the patch is the map's own field
  std::array<std::uint8_t, 256> slot_of_label_{};
  std::unique_ptr<perception::MeshSender> mesh_;  // null: switched off
  std::unique_ptr<SurfaceCast> surface_;          // null: nobody asks for it
  std::uint64_t mesh_seq_ = 0;
  int mesh_waited_ = 0;
  Eigen::AlignedBox3d to_clear_W_;  // empty: nothing
  std::optional<Vec3> mark_W_;      // not answered yet
  int mark_waited_ = 0;
  std::uint64_t mark_seq_ = 0, answered_seq_ = 0, published_answer_ = 0, objects_seq_ = 0;
  perception::TouchAnswer answer_ = perception::TouchAnswer::kNone;
  std::uint8_t answered_id_ = 0;

  rt::ForkJoin* crew_ = &rt::serial();
  bool started_ = false, profiling_ = false;
  // Lost: `confirming_` when the last frame was found and this one is to agree; then X_lost_WC_ is where to
  // look if it does not. `look_again_`: what is to be seen there was not all in the pool yet.
  bool recovering_ = false, confirming_ = false, look_again_ = false;
  int blank_run_ = 0, adrift_run_ = 0;
  Pose X_lost_WC_ = Pose::Identity();
  std::optional<Pose>
      X_looked_WC_;  // from where the map was looked at last, whether it is to be seen there or not
  Profile profile_;
  Pose X_WC_ = Pose::Identity();  // last pose believed
  Vec3 window_centre_W_ = Vec3::Zero();
  bool hand_known_ = false;
  Eigen::Matrix<double, 6, 1> velocity_ = Eigen::Matrix<double, 6, 1>::Zero();  // of C, in C, per s
  rt::Time exposure_{};        // of the last frame consumed
  rt::Time fused_exposure_{};  // of the last frame integrated
  rt::Time seen_{};            // of the last frame claimed
  std::uint64_t frames_ = 0, frames_claimed_ = 0, patch_seq_ = 0, view_seq_ = 0, map_seq_ = 0;
  std::uint64_t periods_ = 0, periods_since_map_ = 0;
  bool map_moves_ = false;  // the last cost map had something that moves

  static constexpr std::size_t kOdometry = 16;
  std::array<OdometryPrior, kOdometry> odometry_{};  // ring, newest at odometry_count_ - 1
  std::uint64_t odometry_count_ = 0;
  // Error of odometry since the scene last constrained everything; and where it was at the last frame.
  double sigma_translation_m_ = 0, sigma_rotation_deg_ = 0;
  std::optional<Pose> X_OB_last_;
  OdometryChain chain_;
};

}  // namespace tasks
