// What a step of the fusion task takes and gives (fusion_task.hpp), and what its stages cost.
//
// Frames: W world (= map), C camera (optical), B robot base, O odometry, V eye of the view. SI.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "perception/body/held_object.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/ground/ground_map.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/objects/object_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/time.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/object_list.hpp"
#include "tasks/contract/scene_view.hpp"
#include "tasks/contract/surface_points.hpp"

namespace tasks {

using perception::Pose;
using perception::Vec3;

// X_OB at an instant, with the velocity there.
struct OdometryPrior {
  rt::Time taken{};
  Pose X_OB = Pose::Identity();
  Vec3 v_OB_B = Vec3::Zero(), w_OB_B = Vec3::Zero();  // m/s, rad/s, in B
};

// In place of a number of a mesh delta: nobody takes any, so none is made.
inline constexpr std::uint64_t kMeshUnwanted = ~std::uint64_t{0};

struct FusionIn {
  const perception::RgbdFrame* frame = nullptr;  // nullptr: there never was one
  bool frame_fresh = false;                      // not handed in before
  HapticState hand;
  std::optional<OdometryPrior> odometry;                           // newest one
  std::span<const perception::VirtualObstacle> virtual_obstacles;  // drawn by the operator
  bool virtual_obstacles_changed = false;
  std::optional<Eigen::AlignedBox3d> clear_W;  // to forget, in addition to what is being cleared
  const perception::GivenObject* given = nullptr;  // to be named now, by the operator
  std::uint16_t drop_object = 0;  // lower bits of the serial of one that is none any more; 0: none
  std::uint64_t mesh_taken = 0;   // seq of the newest delta that its receiver took
  // Not set by the node of this stack: for an arm that grasps, and a view of one's own.
  std::optional<Pose> X_WV;                    // eye of the view; none: the camera
  std::optional<perception::HeldObject> held;  // from grasp to release
};

struct FusionOut {
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

  // Nothing was made yet. The slots that the caller set stay, and so does the last camera.
  void begin() noexcept;
};

// Thread CPU of the stages of the last step, ns; filled only while profiling. Off in the tasks.
struct FusionProfile {
  std::int64_t prepare = 0, track = 0, integrate = 0, raycast = 0, ground = 0, cost_map = 0,
               patch = 0, surface = 0, view = 0, objects = 0, mesh = 0, clear = 0;
  perception::IntegrateTimes integrate_parts;  // of integrate
};

}  // namespace tasks
