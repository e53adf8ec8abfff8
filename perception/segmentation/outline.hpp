// The outline of an object at full resolution. A band round the half-resolution outline is left
// open and flooded from both sides, sure object and sure rest, over the colour differences and
// depth steps between neighbouring pixels (watershed by flooding: Meyer 1994): the two floods meet
// on the highest ridge, be it of colour or of depth. Pixels of the object close to the support stay
// open too, since there depth says little and colour has to. Between two pixels of which one has no
// colour (no_colour.hpp) there is only the depth step.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/object_graph.hpp"
#include "perception/segmentation/surface_patches.hpp"

namespace perception {

struct OutlineConfig {
  // chosen on: mosd_learn, tabletop; judged on: ycb_video
  int inside_px = 3, outside_px = 3;  // of half resolution: how far the band reaches
  // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
  float sure_heights = 2.5F;  // times the support's tolerance: sure object above it
  float light_weight = 0.7F;  // of L against a, b
  float step_cost = 14;       // Lab units that a depth step is worth
  int grow_px = 1;            // the depth's object is taken this much beyond the ridge of colour
  float step_m = 0.008F, step_per_m2 = 0.004F;
};

class OutlineRefiner {
 public:
  OutlineRefiner(int max_width, int max_height);

  // `inside` marks the object at half resolution (1 byte a pixel of the patches' window). The
  // touched pixel (full resolution, in the window) stays in. Does not allocate.
  void refine(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, float mm_per_unit,
              const SurfacePatches& patches, const SupportPlane& plane,
              const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside, int touch_u,
              int touch_v, const OutlineConfig& config) noexcept;

  // Of the last refine(): full-resolution box, and 1 for the object's pixels in it.
  struct Box {
    int u0 = 0, v0 = 0, width = 0, height = 0;
  };
  [[nodiscard]] const Box& box() const noexcept { return box_; }
  [[nodiscard]] bool in(int u, int v) const noexcept {
    u -= box_.u0, v -= box_.v0;
    return u >= 0 && v >= 0 && u < box_.width && v < box_.height &&
           label_[static_cast<std::size_t>(v * box_.width + u)] == kIn;
  }

 private:
  static constexpr std::uint8_t kOpen = 0, kIn = 1, kOut = 2;
  static constexpr int kLevels = 256;
  struct Half;  // the box at half resolution
  void distances(std::span<const std::uint8_t> inside, const Half& half) noexcept;
  void find_wanted(const Half& half) noexcept;
  template <bool kLacking>
  void convert(ImageView<const Rgb> box, const Half& half) noexcept;
  [[nodiscard]] bool find_lacking(ImageView<const Rgb> box) noexcept;
  void mark(const SurfacePatches& patches, const SupportPlane& plane,
            const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside, const Half& half,
            const OutlineConfig& config) noexcept;
  void flood(const OutlineConfig& config) noexcept;
  void grow(const SurfacePatches& patches, const SupportPlane& plane,
            const ObjectGraphConfig& graph, std::span<const std::uint8_t> inside,
            const OutlineConfig& config) noexcept;
  [[nodiscard]] int cost(int i, int j, const OutlineConfig& config) const noexcept;

  Box box_;
  std::array<std::vector<float>, 3> lab_;          // smoothed, where wanted
  std::array<std::vector<float>, 3> raw_, above_;  // a row
  std::vector<float> z_;
  bool lacking_ = false;             // of the box: some pixel has no colour, and
  std::vector<std::uint8_t> known_;  // these have one; else void
  // Of the box, half resolution: city-block distances; where the flood looks at colours.
  std::vector<std::int16_t> to_out_, to_in_;
  std::vector<std::uint8_t> wanted_;
  std::vector<std::uint8_t> label_, state_;
  std::vector<std::int32_t> next_;  // buckets as linked lists
  std::vector<std::uint8_t> level_;
};

}  // namespace perception
