// Parts a region of a frame between pixels that are the object's and pixels that are not: each
// pixel goes to the
// one with the shortest way to it (Dijkstra 1959, from all of them at once). A way costs one a
// pixel; more where it
// crosses a depth step, a valley between two surface pieces, or a change of colour. Where nothing
// of this lies
// between two of them, the border runs half-way. A seed that is not the object's may have a
// longest way: what lies
// beyond it is not parted from the object.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/surface_patches.hpp"

namespace perception {

struct SplitSeed {
  int u = 0, v = 0;  // pixel of the full image
  bool of_object = true;
  float most_px = 0;  // of the full image, the longest way of one that is not the object's; 0: none
};

struct SplitConfig {
  // chosen on: mosd_learn, tabletop, ycb_video; judged on: drawn clutter
  // What a crossing costs, in pixels of half resolution.
  float step_px = 40, valley_px = 20, colour_px = 20;
  float colour_scale = 25;  // Lab units
  float crease_deg = 40;    // a valley of this angle counts fully
  float step_m = 0.008F, step_per_m2 = 0.004F;
};

class SeedSplit {
 public:
  SeedSplit(int max_width, int max_height);

  // At most 250 others. `inside`: a byte a half-resolution pixel of the patches' window, nonzero
  // for the region; left so only where a
  // way from `touched` or from another seed of the object is no longer than from one that is not.
  // Ways run inside
  // the region. What no seed reaches stays. Same input, same bytes; does not allocate.
  void split(const SurfacePatches& patches, const SplitSeed& touched,
             std::span<const SplitSeed> others, const SplitConfig& config,
             std::span<std::uint8_t> inside) noexcept;

 private:
  static constexpr int kLevels = 1024;  // of waiting ways: more than the longest single pass
  [[nodiscard]] static int pass(const SurfacePatches& patches, int i, int j,
                                const SplitConfig& config) noexcept;
  void push(int pixel, int way, std::uint8_t seed) noexcept;

  std::vector<std::int32_t> way_, next_, previous_;
  std::vector<std::uint8_t> seed_;   // 0: not reached; kObject, or kRest + which of the others
  std::vector<std::int32_t> first_;  // of each level of ways, circular
};

}  // namespace perception
