// What a map is made of and how frames enter it: the section `tsdf` of a configuration.
#pragma once

#include <string>

#include "config/schema.hpp"

namespace perception {

struct TsdfConfig {
  double voxel_size_m = 0.01;
  double truncation_m = 0.05;  // at least 2.1 voxels, see effective_truncation()
  double min_depth_m = 0.2;    // nearer readings are ignored
  double max_depth_m = 5.0;    // farther readings carve free space up to here, no more
  double max_weight = 100;     // observations; a cap lets changes be learned
  std::string weighting =
      "uniform";              // or "range": weight falls with the noise, (1.5 m / z)^2, >= 1/4
  double edge_base_m = 0.04;  // a reading is on a depth edge when a neighbour differs by more than
  double edge_per_m = 0.02;   // edge_base_m + edge_per_m * z; edges carve but are not fused
  double colour_band_m = 0.02;   // colour is fused this near to the surface
  int max_blocks = 32768;        // about 4.2 KiB each
  int max_chunks = 4096;         // about 6.2 KiB each
  int max_label_blocks = 2048;   // 1 KiB each; an object of 30 cm takes about 150
  double far_m = 6.0;            // put away beyond; raised to max_depth_m + 1 m
  int far_store_kib = 16384;     // of what is put away, about 0.8 KiB a block; 0: nothing is
  double volume_m = 0;           // edge of a cube in front of the first camera, or 0: unbounded
  double decay_half_life_s = 0;  // of the weight of what is not seen again; 0: never
  bool follow = true;            // surfaces that move slowly (follow/follow.hpp)

  void describe(config::Section& s);
  // truncation_m, raised to 2.1 voxels where the voxels are coarse.
  [[nodiscard]] double effective_truncation() const noexcept;
  // far_m, raised so that what a camera fuses is never put away.
  [[nodiscard]] double effective_far() const noexcept;
};

// The same. Throws std::invalid_argument naming the key, value and range.
const TsdfConfig& checked(const TsdfConfig& config);

}  // namespace perception
