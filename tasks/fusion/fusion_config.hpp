// The configuration of the fusion task ([fusion] in a scene) and what is known when it is built.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <string>

#include "config/schema.hpp"
#include "perception/geometry/articulated_body.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/ground/ground_map.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/objects/object_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/relocalisation/relocaliser.hpp"
#include "perception/tsdf/patch/patch_smooth.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/time.hpp"
#include "tasks/fusion/fusion_body.hpp"

namespace tasks {

using perception::Pose;
using perception::Vec3;

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
  // Voxels: the field round the hand is smoothed over so many
  // (perception/tsdf/patch/patch_smooth.hpp); 0: as it is in the map.
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
  // The robot that carries the camera, where it has an arm that may be in view; null: none, and no
  // frame's joints are looked at.
  std::shared_ptr<const perception::RobotDescription> robot;
  perception::GroundPrior ground;  // robots: up = z, camera height, start of the base
  std::array<perception::Material, perception::SurfacePatch::kMaxMaterials> palette{};
  rt::Nanos period{33333333};
  bool ray_cast = false;  // somebody touches by the published method: it gets its ray cast
};

// Throws std::invalid_argument naming key, value, range.
void require_valid(const FusionConfig& config, const FusionSetup& setup);

}  // namespace tasks
