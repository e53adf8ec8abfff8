// A recorded RGB-D sequence through the fusion task to camera poses and a mesh: what `teletact
// fuse` does. Its options are told in tools/teletact/cmd_fuse.cpp.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "perception/tsdf/mesh/mesh.hpp"

namespace teletact {

// Options that stand for one key of [fusion].
struct FuseKnob {
  const char *option, *key, *help;
};
inline constexpr std::array<FuseKnob, 8> kFuseKnobs{{
    {"--truncation", "tsdf.truncation_m", "half width of the stored band, m"},
    {"--min-depth", "tsdf.min_depth_m", "nearer readings are not fused, m"},
    {"--max-depth", "tsdf.max_depth_m", "farther readings are not fused, m"},
    {"--max-weight", "tsdf.max_weight", "cap of a voxel's weight, observations"},
    {"--iterations-fine", "level_0.iterations_fine", "of ICP, at full resolution"},
    {"--iterations-middle", "level_0.iterations_middle", "of ICP, at half"},
    {"--iterations-coarse", "level_0.iterations_coarse", "of ICP, at a quarter"},
    {"--pixel-step", "level_0.pixel_step", "every n-th pixel is tracked: 1, 2, 4"},
}};

struct FuseOptions {
  std::string rgbd, intrinsics, bias, odometry, json, poses, ply, map, save_map, isa = "auto";
  std::optional<double> voxel_m;
  bool full_size = false;
  std::string config_file;
  std::vector<std::string> overrides;
  std::array<std::string, kFuseKnobs.size()> knobs;  // their values; empty: not given
  double mesh_weight = perception::MeshOptions{}.min_weight;
};

// Prints every key of [fusion].
void list_fuse_knobs();

// Exit code: 1 where no frame was tracked, or the map is none of the recording. Throws
// std::runtime_error with one line; then none of the outputs is left.
[[nodiscard]] int fuse_recording(const FuseOptions& o);

}  // namespace teletact
