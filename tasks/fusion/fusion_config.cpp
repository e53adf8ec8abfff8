#include "tasks/fusion/fusion_config.hpp"

#include <stdexcept>

#include "perception/geometry/rgbd_frame.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "tasks/contract/scene_view.hpp"

namespace tasks {

namespace {

using perception::RgbdFrame;
using perception::SurfacePatch;

void check(bool ok, const char* key, double value, const char* range) {
  if (ok) return;
  throw std::invalid_argument("fusion." + std::string(key) + " = " + std::to_string(value) +
                              ": must be " + range);
}

}  // namespace

void require_valid(const FusionConfig& config, const FusionSetup& setup) {
  const auto& k = setup.camera;
  check(k.valid() && k.width <= RgbdFrame::kMaxWidth && k.height <= RgbdFrame::kMaxHeight,
        "camera.width", k.width, "a valid camera of at most 640 x 480");
  check(config.patch_nodes >= 8 && config.patch_nodes <= SurfacePatch::kMaxNodes &&
            config.patch_nodes % 4 == 0,
        "patch_nodes", config.patch_nodes, "a multiple of 4 in 8 .. 64");
  check(config.patch_smooth == 0 || config.patch_smooth >= 2, "patch_smooth", config.patch_smooth,
        "0, or 2 .. 8");
  check(config.view_step >= 1 && (k.width - 1) / config.view_step < SceneView::kMaxWidth &&
            (k.height - 1) / config.view_step < SceneView::kMaxHeight,
        "view_step", config.view_step, "large enough for a view of 320 x 240");
  check(config.level_count >= 1 && config.level_count <= FusionConfig::kMaxLevels, "level_count",
        config.level_count, "1 .. 4");
  check(config.mesh_blocks >= 0 && config.mesh_blocks < perception::MeshDelta::kMostBlocks,
        "mesh_blocks", config.mesh_blocks, "0 .. 511");
  check(config.mesh_period_frames >= 1, "mesh_period_frames", config.mesh_period_frames,
        "at least 1");
  check(config.surface_periods >= 1, "surface_periods", config.surface_periods, "at least 1");
  check(config.cost_map_period >= 1, "cost_map_period", config.cost_map_period, "at least 1");
  for (const FusionLevel& level : config.levels) {
    check(level.pixel_step == 1 || level.pixel_step == 2 || level.pixel_step == 4,
          "level.pixel_step", level.pixel_step, "1, 2 or 4");
    const int step = level.allocate_step;
    check(step == 1 || step == 2 || step == 4 || step == 8, "level.allocate_step", step,
          "1, 2, 4 or 8");
  }
}

void FusionConfig::describe(config::Section& s) {
  tsdf.describe(s.section("tsdf", "the map"));
  tracker.describe(s.section("tracker", "camera tracking"));
  motion.describe(s.section("motion", "what moves in the image"));
  relocaliser.describe(s.section("relocaliser", "what brings a lost camera back"));
  ground.describe(s.section("ground", "ground plane and cost map"));
  body.describe(s.section("body", "the robot's own body in the image"));
  describe_objects(s.section("objects", "objects named by a touch"));
  s.integer("patch_nodes", patch_nodes, 8, SurfacePatch::kMaxNodes,
            "edge of the haptic window, a multiple of 4")
      .number("window_lead_periods", window_lead_periods, 0, 10,
              "the window is centred where the hand will be after this many periods")
      .number("patch_smooth", patch_smooth, 0, 8,
              "voxels that the field round the hand is smoothed over, 2 or more; 0: as it is in "
              "the map")
      .flag("patch_checksums", patch_checksums, "write a checksum into every patch")
      .integer("view_period_frames", view_period_frames, 0, 300, "0 switches the view off")
      .integer("view_step", view_step, 1, 8, "camera pixels a view pixel")
      .number("view_min_weight", view_min_weight, 1, 64,
              "observations that what the view shows has at least")
      .integer("cost_map_period", cost_map_period, 1, 300, "periods between two cost maps")
      .integer("mesh_blocks", mesh_blocks, 0, perception::MeshDelta::kMostBlocks - 1,
               "changed blocks whose triangles are sent to the console at once; 0: no mesh")
      .integer("mesh_period_frames", mesh_period_frames, 1, 300, "periods between two of these")
      .integer("surface_periods", surface_periods, 1, 15,
               "periods that the ray cast for haptic.method = \"force_shading\" is made in")
      .text("map", map, {}, "stored map to begin with, its voxel this map's; empty: none")
      .number("odometry_translation_share", odometry_translation_share, 0, 1,
              "error of odometry, share of the way")
      .number("odometry_rotation_share", odometry_rotation_share, 0, 1,
              "error of odometry, share of the turn")
      .number("odometry_deg_per_m", odometry_deg_per_m, 0, 90, "heading error of odometry a metre")
      .number("velocity_decay", velocity_decay, 0, 1,
              "of the velocity prior, in a frame that is not claimed")
      .integer("blank_frames", blank_frames, 0, 300,
               "images without a reading in a row after which the camera counts as moved unseen")
      .number(
          "leap_translation_m", leap_translation_m, 0, 10,
          "from the prior in one frame; farther is claimed only where no other place looks alike")
      .number("leap_rotation_deg", leap_rotation_deg, 0, 180, "the same of the turn")
      .integer("level_count", level_count, 1, kMaxLevels, "variants, largest first");
  for (std::size_t i = 0; i < levels.size(); ++i) {
    auto& l = levels[i];
    s.section("level_" + std::to_string(i), "variant " + std::to_string(i))
        .integer("pixel_step", l.pixel_step, 1, 4, "1, 2 or 4: pixels of tracking and its ray cast")
        .integer("allocate_step", l.allocate_step, 1, 8,
                 "1, 2, 4 or 8: pixels that allocate blocks")
        .integer("iterations_fine", l.iterations[0], 0, 50, "of ICP at full resolution")
        .integer("iterations_middle", l.iterations[1], 0, 50, "at half")
        .integer("iterations_coarse", l.iterations[2], 0, 50, "at a quarter");
  }
}

void ObjectMaterial::describe(config::Section& s, const char* of) {
  const std::string whose(of);
  s.number("stiffness_scale", stiffness_scale, 0.01, 1, whose + ", times the device's stiffness")
      .number("friction_static", friction_static, 0, 2, whose)
      .number("friction_dynamic", friction_dynamic, 0, 2, whose)
      .number("texture_amplitude_m", texture_amplitude_m, 0, 0.005, whose)
      .number("texture_period_m", texture_period_m, 0, 0.1, whose);
}

void FusionConfig::describe_objects(config::Section& s) {
  objects.describe(s);
  object_material.describe(s, "of objects");
  s.list(
      "material",
      [this](config::Section& item) {
        MaterialOfObject& m = object_materials.emplace_back();
        item.integer("id", m.id, 1, perception::ObjectMap::kMost,
                     "which object: they are numbered as they are marked");
        m.material.describe(item, "of this object");
      },
      "surface of one object instead of that of all");
}

}  // namespace tasks
