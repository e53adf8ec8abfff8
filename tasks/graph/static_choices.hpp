// What is fixed at the start of a run, best first: admission takes the first that fits this host
// (rt/sched/admission.hpp, 4). Only fusion chooses: its voxel size.
//
// The floor: 30 Hz fusion, voxels of at most 20 mm, all three levels of the tracking's pyramid, at
// least 5 ms for planning. Below it nothing is admitted: the program says which task does not fit,
// with figures.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "rt/sched/task_spec.hpp"
#include "tasks/contract/table.hpp"

namespace tasks {

struct VoxelChoice {
  double voxel_m;
  std::array<std::int64_t, 4> budgets_us;  // declared, by level; calibration replaces them
};

inline constexpr std::array<VoxelChoice, 2> kVoxelChoices{{
    {0.010, {28000, 18000, 14000}},
    {0.020, {25000, 12000, 9000}},
}};

// What the published method of touch adds where a scene asks for it, declared: to fusion its ray
// cast, on one thread, of which a job at any level makes one of fusion.surface_periods parts; to a
// tick of haptic the reduction over its points.
// chosen on: test room, 512 x 424, 20 mm: 74 ms, reduction p99 51 us; judged on: default_room: 69 ms
inline constexpr std::int64_t kRayCast_us = 80000;
inline constexpr std::int64_t kReduction_us = 100;

inline constexpr double kFloorVoxel_m = 0.020;
inline constexpr std::int64_t kFloorFusion_hz = 30;
inline constexpr std::int64_t kFloorPlanning_us = 5000;

// What the scene leaves to choose from.
struct ChoiceLimits {
  // fusion.tsdf.voxel_size_m where the scene names it: then there is no choice. 0: it does not.
  double named_voxel_m = 0;
  // The touch window: `patch_nodes` voxels wide; the hand must not outrun it (definition of the
  // patch): half of it >= hand speed limit x workspace scale x 100 ms + 50 mm.
  int patch_nodes = 0;  // 0: not looked at
  double needed_half_extent_m = 0;
  // haptic.method = "force_shading": what a job of fusion pays for it, on top of what is declared,
  // and haptic the reduction. 0: no.
  std::int64_t ray_cast_us = 0;
  // Picture codecs that the scene names: what a job of capture pays for them (picture_cost.hpp).
  std::int64_t encode_us = 0;
};

// "20 mm"
[[nodiscard]] std::string voxel_name(double voxel_m);

// Names and voxel sizes that fusion may be built with, best first; why not, where the window is too
// small.
struct VoxelOption {
  double voxel_m = 0;
  std::string name, ruled_out;
  std::array<std::int64_t, 4> budgets_us{};
};
[[nodiscard]] std::vector<VoxelOption> voxel_options(const ChoiceLimits& limits);

// Voxel size of a settled fusion spec. Throws std::logic_error for a name that is no option.
[[nodiscard]] double chosen_voxel_m(const rt::TaskSpec& fusion, const ChoiceLimits& limits);

}  // namespace tasks
