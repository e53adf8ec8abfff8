// Segmentation of a whole image with depth: every thing, what it stands on, and where depth is
// missing the regions of colour (region_merge.hpp).
//
// The pieces of the frame (surface_patches.hpp) are joined as for a touch (object_graph.hpp): the
// support that most of the surface lies on is taken out as one region, depth steps and valleys part
// the rest. Pixels near a border then go to the region whose readings and colours, where there are
// any, round them are the most alike, at full resolution. Each 4-connected part is a region of its
// own; one below min_share joins the neighbour it has the longest border with. Fixed order: same
// input, same bytes. Sets up its own memory: not for a real-time step.
#pragma once

#include <cstdint>

#include "perception/segmentation/object_graph.hpp"
#include "perception/segmentation/region_merge.hpp"
#include "perception/segmentation/surface_patches.hpp"

namespace perception {

struct WholeDepthConfig {
  WholeImageConfig colour;  // where there is no reading
  PatchesConfig patches;
  ObjectGraphConfig graph;
  float support_reach_m = 10;  // the support is looked for in all of the frame
  // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
  int border_px = 2;         // how far from a border pixels are looked at again
  float step_cost = 30;      // Lab units that a depth step is worth
  double min_share = 0.002;  // of the image
};

// Depth in units of mm_per_unit, of the colour image's size; 0 and 65535 are no reading. Labels as
// of segment_whole(rgb).
[[nodiscard]] WholeImage segment_whole(ImageView<const Rgb> rgb,
                                       ImageView<const std::uint16_t> depth, const Intrinsics& k,
                                       float mm_per_unit, const WholeDepthConfig& config);

}  // namespace perception
