// The object under a touch, or every region of an image, from image files: what `teletact segment`
// does. Its options are told in tools/teletact/cmd_segment.cpp.
#pragma once

#include <string>
#include <vector>

#include "perception/segmentation/region_grow.hpp"

namespace teletact {

struct SegmentOptions {
  std::string color, depth, intrinsics, method = "default", out, json;
  std::vector<std::string> touches, nots;
  bool whole = false, one_object = false;  // one_object: all touches name the same one
  double depth_unit_mm = 1;
  perception::GrowConfig grow;
};

// The options fit together. Writes all outputs or none. Throws std::runtime_error with one line.
void segment_image(const SegmentOptions& o);

}  // namespace teletact
