#include "perception/tsdf/blocks/tsdf_config.hpp"

#include <algorithm>
#include <stdexcept>

namespace perception {
namespace {

void require(bool ok, const char* key, double value, const char* range) {
  if (ok) return;
  throw std::invalid_argument("tsdf." + std::string(key) + " = " + std::to_string(value) +
                              ": must be " + range);
}

}  // namespace

const TsdfConfig& checked(const TsdfConfig& c) {
  require(c.voxel_size_m >= 0.002 && c.voxel_size_m <= 0.1, "voxel_size_m", c.voxel_size_m,
          "0.002 to 0.1");
  require(c.truncation_m >= 0.005 && c.truncation_m <= 0.5, "truncation_m", c.truncation_m,
          "0.005 to 0.5");
  require(c.min_depth_m >= 0.05 && c.min_depth_m < c.max_depth_m, "min_depth_m", c.min_depth_m,
          "0.05 to max_depth_m");
  require(c.max_depth_m <= 20, "max_depth_m", c.max_depth_m, "at most 20");
  require(c.max_weight >= 2 && c.max_weight <= 255, "max_weight", c.max_weight, "2 to 255");
  require(c.edge_base_m >= 0 && c.edge_base_m <= 10, "edge_base_m", c.edge_base_m, "0 to 10");
  require(c.edge_per_m >= 0 && c.edge_per_m <= 0.4, "edge_per_m", c.edge_per_m, "0 to 0.4");
  require(c.colour_band_m >= 0 && c.colour_band_m <= 0.5, "colour_band_m", c.colour_band_m,
          "0 to 0.5");
  require(c.max_blocks >= 1 && c.max_blocks <= 1 << 20, "max_blocks", c.max_blocks, "1 to 1048576");
  require(c.max_label_blocks >= 1 && c.max_label_blocks <= 1 << 18, "max_label_blocks",
          c.max_label_blocks, "1 to 262144");
  require(c.max_chunks >= 1 && c.max_chunks <= 1 << 16, "max_chunks", c.max_chunks, "1 to 65536");
  require(c.far_m >= 1 && c.far_m <= 1000, "far_m", c.far_m, "1 to 1000");
  require(c.far_store_kib >= 0 && c.far_store_kib <= 1 << 21, "far_store_kib", c.far_store_kib,
          "0 to 2097152");
  require(c.volume_m == 0 || (c.volume_m >= 0.1 && c.volume_m <= 1000), "volume_m", c.volume_m,
          "0 (unbounded), or 0.1 to 1000");
  require(c.decay_half_life_s >= 0 && c.decay_half_life_s <= 1e6, "decay_half_life_s",
          c.decay_half_life_s, "0 to 1000000");
  if (c.weighting != "uniform" && c.weighting != "range")
    throw std::invalid_argument("tsdf.weighting = \"" + c.weighting +
                                "\": must be \"uniform\" or \"range\"");
  return c;
}

void TsdfConfig::describe(config::Section& s) {
  s.number("voxel_size_m", voxel_size_m, 0.005, 0.08, "edge of a voxel");
  s.number("truncation_m", truncation_m, 0.01, 0.4,
           "half width of the stored band; raised to 2.1 voxels");
  s.number("min_depth_m", min_depth_m, 0.05, 2, "nearer readings are ignored");
  s.number("max_depth_m", max_depth_m, 0.5, 12, "farther readings only carve free space");
  s.number("max_weight", max_weight, 2, 255, "cap of the running mean, observations");
  s.text("weighting", weighting, {"uniform", "range"},
         "weight of a reading: 1, or falling with depth as the sensor's noise grows");
  s.number("edge_base_m", edge_base_m, 0, 1, "depth step that is an edge, at depth 0");
  s.number("edge_per_m", edge_per_m, 0, 0.4, "growth of that step with depth");
  s.number("colour_band_m", colour_band_m, 0, 0.1, "distance from the surface that takes colour");
  s.integer("max_blocks", max_blocks, 64, 262144, "pool of 8^3 blocks, 4.2 KiB each");
  s.integer("max_label_blocks", max_label_blocks, 64, 65536,
            "pool of the labels of blocks that hold a part of an object, 1 KiB each");
  s.integer("max_chunks", max_chunks, 8, 65536, "pool of 64^3 chunks, 6.2 KiB each");
  s.number("far_m", far_m, 1, 1000,
           "chunks farther from camera and hand are compressed out of the pool; at least "
           "max_depth_m + 1");
  s.integer("far_store_kib", far_store_kib, 0, 1 << 21,
            "where they are put, about 0.8 KiB a block; 0: nothing is put away");
  s.number("volume_m", volume_m, 0, 1000,
           "edge of a cube in front of the first camera, outside of which nothing is kept; 0: "
           "unbounded");
  s.number("decay_half_life_s", decay_half_life_s, 0, 1e6,
           "weight of what is not seen again halves in this time; 0: never");
  s.flag("follow", follow, "surfaces that move slowly while they are looked at are followed");
}

double TsdfConfig::effective_far() const noexcept { return std::max(far_m, max_depth_m + 1.0); }

double TsdfConfig::effective_truncation() const noexcept {
  return std::max(truncation_m, 2.1 * voxel_size_m);
}

}  // namespace perception
