#include "tasks/graph/static_choices.hpp"

#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace tasks {

namespace {

constexpr const TaskRow& row(TaskId id) { return kTaskTable[index_of(id)]; }

constexpr std::int64_t least_budget_us(const TaskRow& r) {
  std::int64_t least = r.variants[0].budget_us;
  for (const VariantRow& v : r.variants) {
    if (!v.name.empty() && v.budget_us < least) least = v.budget_us;
  }
  return least;
}

static_assert(kVoxelChoices.back().voxel_m <= kFloorVoxel_m, "no choice below the floor");
static_assert(row(TaskId::kFusion).rate_hz >= kFloorFusion_hz, "no rate below the floor");
static_assert(least_budget_us(row(TaskId::kPlanning)) >= kFloorPlanning_us,
              "no budget of planning below the floor");

// Half the distance between the outermost nodes.
double half_extent_m(const ChoiceLimits& limits, double voxel_m) {
  return 0.5 * (limits.patch_nodes - 1) * voxel_m;
}

std::string too_small(const ChoiceLimits& limits, double voxel_m) {
  if (limits.patch_nodes == 0) return {};
  const double half = half_extent_m(limits, voxel_m);
  if (half >= limits.needed_half_extent_m) return {};
  char text[200];
  std::snprintf(
      text, sizeof text,
      "the touch window of %d nodes reaches %.3f m, a hand at its speed limit needs %.3f m",
      limits.patch_nodes, half, limits.needed_half_extent_m);
  return text;
}

bool same(double a, double b) { return std::abs(a - b) < 1e-6; }

}  // namespace

std::string voxel_name(double voxel_m) {
  char text[32];
  std::snprintf(text, sizeof text, "%g mm", std::round(voxel_m * 1e6) * 1e-3);
  return text;
}

std::vector<VoxelOption> voxel_options(const ChoiceLimits& limits) {
  std::vector<VoxelOption> options;
  for (const VoxelChoice& c : kVoxelChoices) {
    if (limits.named_voxel_m > 0 && !same(c.voxel_m, limits.named_voxel_m)) continue;
    options.push_back(
        {c.voxel_m, voxel_name(c.voxel_m), too_small(limits, c.voxel_m), c.budgets_us});
  }
  if (!options.empty()) return options;
  // A size that only this scene has: declared as the next finer one, or as the finest.
  const VoxelChoice* like = &kVoxelChoices.front();
  for (const VoxelChoice& c : kVoxelChoices) {
    if (c.voxel_m <= limits.named_voxel_m) like = &c;
  }
  options.push_back({limits.named_voxel_m, voxel_name(limits.named_voxel_m),
                     too_small(limits, limits.named_voxel_m), like->budgets_us});
  return options;
}

double chosen_voxel_m(const rt::TaskSpec& fusion, const ChoiceLimits& limits) {
  for (const VoxelOption& o : voxel_options(limits)) {
    if (o.name == fusion.choice) return o.voxel_m;
  }
  throw std::logic_error("fusion: '" + fusion.choice + "' is no voxel size of this scene");
}

}  // namespace tasks
