// Copies the used part of a frame: at 512 x 424 two thirds of what the whole struct holds.
#pragma once

#include <algorithm>

#include "perception/geometry/rgbd_frame.hpp"

namespace drivers {

inline void copy_frame(const perception::RgbdFrame& from, perception::RgbdFrame& to) noexcept {
  const std::size_t n = static_cast<std::size_t>(from.intrinsics.width) *
                        static_cast<std::size_t>(from.intrinsics.height);
  to.exposure = from.exposure;
  to.seq = from.seq;
  to.intrinsics = from.intrinsics;
  to.has_colour = from.has_colour;
  to.joints = from.joints;
  std::copy_n(from.depth_mm.data(), n, to.depth_mm.data());
  if (from.has_colour) std::copy_n(from.colour.data(), n, to.colour.data());
}

}  // namespace drivers
