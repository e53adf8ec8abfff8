// intrinsics.txt beside depth images: one line "fx fy cx cy width height depth_units_per_metre",
// px; '#' begins a comment line. Read strictly: an error names file, line, value and allowed range.
#pragma once

#include <string>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/result.hpp"

namespace drivers {

struct DepthIntrinsics {
  perception::Intrinsics k;
  double units_per_metre = 1000;
};
[[nodiscard]] rt::Result<DepthIntrinsics> read_intrinsics(const std::string& path);

}  // namespace drivers
