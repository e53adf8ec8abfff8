#pragma once

#include <cstdint>

namespace perception {

// Deterministic work counts of one integrate(); a job's cost follows them.
struct IntegrateStats {
  bool refused = false;     // pose or image not usable: the map is unchanged
  std::int32_t pixels = 0;  // readings in range, edges excluded
  std::int32_t rays = 0;    // readings whose band was allocated
  std::int32_t blocks_new = 0;
  std::int32_t blocks_refused = 0;  // fault when > 0: block pool or chunk pool full (band lost)
  std::int32_t chunks_refused = 0;  // chunks of free space that did not fit
  std::int32_t blocks_updated = 0;
  std::int64_t voxels_fused = 0;    // inside the band
  std::int64_t voxels_carved = 0;   // known voxels seen through
  std::int64_t free_tests = 0;      // cubes tested for free space
  std::int32_t blocks_fetched = 0;  // restored because they are in view
  std::int32_t blocks_moved = 0;    // with their surface
  std::int64_t follow_tests = 0;    // readings compared for that, and nodes examined
};

// Thread CPU of the stages of the last integrate(), ns; filled only while it is being measured.
struct IntegrateTimes {
  std::int64_t ready = 0, allocate = 0, update = 0, carve = 0;
};

}  // namespace perception
