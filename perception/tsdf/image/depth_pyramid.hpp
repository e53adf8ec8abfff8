// One depth image prepared for fusion: for each pixel its depth, its weight and the length of its
// band; and a pyramid of least and greatest depth, which bounds the depth within any rectangle of
// pixels.
//
// A pixel is   0 (no reading) | depth_mm + (weight << 16) + (reach << 24).
// Reach: reach_gain / cos(angle between ray and normal), unit 1/32, from 1 to 3: seen at a grazing
// angle the band must be longer along the ray to keep some thickness across the surface.
// Weight 0 with a depth: carves free space up to that depth and is not fused. So are
//   readings beyond max_depth;
//   readings on a depth edge, with the least depth of the 3x3 neighbourhood (a flying pixel lies
//   between two surfaces: nothing behind the near one is known free);
//   readings of what moves (FrameView::moving);
//   single holes (at least 6 of the 8 neighbours have a reading), with the least of those.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

struct DepthRule {
  float min_depth_m, max_depth_m;
  float edge_base_m, edge_per_m;
  float fx, fy, cx, cy;
  float reach_gain;
  bool range_weight;  // weight (1.5 m / z)^2 in [1/4, 1], else 1
};

class DepthPyramid {
 public:
  static constexpr int kMaxWidth = 640, kMaxHeight = 480;
  static constexpr int kLevels = 7;  // tiles of 1, 2, 4, ... 64 px
  static constexpr int kWeightOne = 128;
  static constexpr int kReachOne = 32, kReachMost = 96;
  static constexpr int kFillFrom = 6;  // neighbours with a reading that fill a hole

  explicit DepthPyramid(rt::NonRealtime&);
  // Returns the number of pixels with weight > 0. The image is at most kMaxWidth x kMaxHeight.
  // `mask` (optional, of the image's size): readings where it is not 0 carve free space and are not
  // fused.
  int build(ImageView<const std::uint16_t> depth_mm, const DepthRule& rule,
            rt::ForkJoin& crew = rt::serial(), ImageView<const std::uint8_t> mask = {}) noexcept;

  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  [[nodiscard]] const std::uint32_t* pixels() const noexcept {
    return pixels_.data();
  }  // row-major

  [[nodiscard]] std::size_t memory_bytes() const noexcept;

  struct Range {
    std::uint16_t least_mm, greatest_mm;
  };  // least 0: some pixel has no reading
  struct Tile {
    std::uint16_t least_mm, below_top_mm;  // greatest: 65535 - below_top_mm
  };
  // Of the pixels u0..u1, v0..v1 (inclusive, inside the image), and perhaps of a few beside them.
  [[nodiscard]] Range range(int u0, int v0, int u1, int v1) const noexcept;

 private:
  struct Level {
    int width = 0, height = 0;
    std::vector<Tile> tiles;
  };
  [[nodiscard]] const std::uint16_t* padded_row(int v) const noexcept;
  // Pixels and tiles of rows v0 .. v1 - 1, v0 a multiple of the largest tile; number of pixels with
  // weight.
  int build_strip(const DepthRule& rule, ImageView<const std::uint8_t> mask, int v0,
                  int v1) noexcept;
  void build_tiles(int level, int v0, int v1) noexcept;
  int width_ = 0, height_ = 0;
  std::vector<std::uint16_t> padded_;  // sanitised readings with a border of 0
  std::vector<std::uint32_t> pixels_;  // a spare at width * height, always 0; padded
  std::array<Level, kLevels> levels_;
};

}  // namespace perception
