// teletact fuse: a recorded RGB-D sequence to camera poses and a coloured mesh, through the very
// task that runs in the demo (tasks/fusion).
//
//   --rgbd DIR       TUM or 7-Scenes layout (drivers/camera/tum_reader.hpp); its ground truth is
//                    never opened
//   --intrinsics fx,fy,cx,cy[,units]  of a folder without intrinsics.txt; px, depth units a metre
//   --bias FILE      TOML with the camera's depth bias, [[camera.bias]] at_mm, bias_mm
//                    (drivers/camera/ depth_bias.hpp): taken out of every depth image
//   --odometry FILE  TUM lines "t tx ty tz qx qy qz qw", camera to its own start, as motion prior
//   --voxel M        edge of a voxel; other knobs that have an option of their own: --help
//   --config FILE    TOML with a table [fusion], as in a scene, and [[camera.bias]]; --set
//                    fusion.KEY=VALUE for one key of it; --list-knobs prints them all
//   --poses OUT.txt  TUM lines, camera to world (world = first camera). A data line is a claim; a
//                    frame that is lost, or that the scene and the odometry leave open, is a
//                    comment
//   --ply OUT.ply    the fused surface, if wanted
//   --save-map OUT   the map and its keyframes (perception/map_file)
//   --map FILE       such a map to begin with: world = that map's; lost until the camera is found
//                    in it
//
// Images of 640 x 480 are brought to 512 x 424, the size the stack works at, unless --full-size.
// Outputs appear whole or not at all. Same input, same bytes.
#include <CLI/CLI.hpp>

#include "tools/cli/options.hpp"
#include "tools/offline/fuse.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

// Thrown out of the parsing, for required options are then not needed.
struct ListKnobs {};

}  // namespace

int cmd_fuse(int argc, char** argv) {
  FuseOptions o;
  CLI::App app("teletact fuse: camera poses and a mesh from a recorded RGB-D sequence",
               "teletact fuse");
  app.add_option("--rgbd", o.rgbd, "folder in TUM or 7-Scenes layout")->required();
  app.add_option(
      "--intrinsics", o.intrinsics,
      "where the folder has no intrinsics.txt: fx,fy,cx,cy in px, and depth units a metre "
      "if the data set's are not right");
  app.add_option("--bias", o.bias, "TOML with [[camera.bias]]: depth bias to subtract");
  app.add_option("--odometry", o.odometry, "TUM poses used as motion prior");
  app.add_option("--voxel", o.voxel_m, "edge of a voxel, m; 0.01 where nothing is said")
      ->check(in_range(0.004, 0.1));
  for (std::size_t i = 0; i < kFuseKnobs.size(); ++i) {
    app.add_option(kFuseKnobs[i].option, o.knobs[i], kFuseKnobs[i].help);
  }
  app.add_option("--mesh-weight", o.mesh_weight, "observations from which a voxel is meshed")
      ->check(in_range(1, 255))
      ->capture_default_str();
  app.add_option("--config", o.config_file, "TOML with a table [fusion] and [[camera.bias]]");
  app.add_option("--set", o.overrides, "any key of it: fusion.KEY=VALUE");
  app.add_flag_callback(
      "--list-knobs", [] { throw ListKnobs(); }, "print every key of [fusion] and end");
  app.add_option("--poses", o.poses, "TUM poses to write, camera to world")->required();
  app.add_option("--ply", o.ply, "mesh to write, if wanted");
  app.add_option("--map", o.map, "map of an earlier run to begin with, of the same voxel");
  app.add_option("--save-map", o.save_map, "map to write");
  app.add_option("--json", o.json, "figures to write");
  app.add_option("--isa", o.isa, "auto, scalar, sse4, avx2, avx512: the same bytes, another speed")
      ->capture_default_str();
  app.add_flag("--full-size", o.full_size, "do not bring 640 x 480 images to 512 x 424");
  try {
    if (!parse_options(app, argc, argv)) return 0;
  } catch (const ListKnobs&) {
    list_fuse_knobs();
    return 0;
  }
  return fuse_recording(o);
}

}  // namespace teletact
