// From a touch to an object, method `default`: surface pieces of the frame (surface_patches.hpp),
// the support taken out and the pieces joined (object_graph.hpp), the outline at full resolution
// (outline.hpp). What the touch names, beyond the region it hits:
//   - on a hole of the depth, or a piece too small for a plane: the nearest region of like colour
//   - on the support, but of another colour: a flat thing, grown by colour
//   - on the support: the support
//   - where there is no colour (no_colour.hpp): what distance alone names
//   - parts of one object at both sides of an occluder belong together
// set_frame() once a frame, then touch() for each object; or follow() for one and also() for others
// in its window: pieces and regions are made once for all of them. None of them allocates or
// throws.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/outline.hpp"
#include "perception/segmentation/seed_split.hpp"

namespace perception {

struct TouchConfig {
  PatchesConfig patches;
  ObjectGraphConfig graph;
  OutlineConfig outline;
  // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
  float flat_colour = 12;     // Lab units from the support's colour that make a flat thing
  int follow_margin_px = 24;  // of the full image: how far the window reaches beyond the seed
  float follow_share = 0.5F;  // of a region's pixels that the projected object must cover
  float occluded_cm2 = 15;    // a part behind an occluder counts from this seen area
};

class TouchSegmenter {
 public:
  TouchSegmenter(int max_width, int max_height, const TouchConfig& config = {});

  // The images must outlive the calls of touch() and follow(). depth in units of mm_per_unit. The
  // window limits the work to a part of the frame.
  void set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                 const Intrinsics& k, float mm_per_unit) noexcept;
  void set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                 const Intrinsics& k, float mm_per_unit, const HalfWindow& window) noexcept;

  // The object at pixel (u, v) of the full image. False, with a mask of that pixel alone, when
  // there is no depth near it.
  bool touch(int u, int v) noexcept;
  // The same with other settings of regions and outline than the configuration's. Further pixels,
  // if any: the regions of those that are the object's (of_object) belong to it, and it ends where
  // it is nearer to one that is not (seed_split.hpp).
  bool touch(int u, int v, const ObjectGraphConfig& graph, const OutlineConfig& outline,
             std::span<const SplitSeed> others, const SplitConfig& split) noexcept;
  // Pixels (inclusive) of the image.
  struct SeedBox {
    int u0, v0, u1, v1;
  };
  // Where an object's fused labels project to.
  struct Seed {
    ImageView<const std::uint8_t> image{};  // only pixels at even coordinates (in steps) are read
    std::uint8_t id = 0;                    // what has this value; 0: what is not 0
    int step = 1;  // pixels of `image` to one of the colour image, which may be a reduced one
  };
  // The object that covers the seed, in a window round it; it takes the place of set_frame(). False
  // when no region is covered.
  bool follow(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, const Intrinsics& k,
              float mm_per_unit, ImageView<const std::uint8_t> seed) noexcept;
  // The same for whoever knows the pixels that hold all of the seed; the box may be larger.
  bool follow(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth, const Intrinsics& k,
              float mm_per_unit, const Seed& seed, const SeedBox& box) noexcept;
  // After a follow() that found its object: another one that stands on the same support, in the
  // same window.
  bool also(const Seed& seed) noexcept;

  // Of the last touch() or follow().
  [[nodiscard]] const OutlineRefiner::Box& box() const noexcept { return outline_.box(); }
  [[nodiscard]] bool in(int u, int v) const noexcept { return outline_.in(u, v); }
  [[nodiscard]] const SupportPlane& support() const noexcept { return plane_; }
  // The last touch() named the support itself: nothing stands there.
  [[nodiscard]] bool named_support() const noexcept { return named_support_; }

 private:
  bool choose_covered(const Seed& seed) noexcept;
  void select_region(int region) noexcept;
  void select_flat(int pixel) noexcept;
  void add_occluded_parts(int region, const ObjectGraphConfig& graph) noexcept;
  [[nodiscard]] int pixel_of(int u, int v) const noexcept;
  void choose_others(std::span<const SplitSeed> others) noexcept;
  [[nodiscard]] int nearest_region(int u, int v) const noexcept;
  struct Colour : Lab {
    bool known = false;
  };
  [[nodiscard]] Colour colour_near(int u, int v) const noexcept;

  TouchConfig config_;
  SurfacePatches patches_;
  ObjectGraph graph_;
  OutlineRefiner outline_;
  SeedSplit split_;
  SupportPlane plane_;
  ImageView<const Rgb> rgb_;
  ImageView<const std::uint16_t> depth_;
  float mm_per_unit_ = 1;
  bool named_support_ = false;
  std::vector<std::uint8_t> inside_;
  std::vector<std::uint8_t> chosen_;  // a byte a piece
  std::vector<std::int32_t> queue_;
  std::vector<float> covered_;
};

}  // namespace perception
