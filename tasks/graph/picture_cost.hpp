// Declared CPU of picture codecs, on top of lossless depth and JPEG. Stated at 512 x 424; other
// cameras in proportion to their pixels.
#pragma once

#include <cstdint>

#include "drivers/link/picture_config.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace tasks {

struct PictureCost {
  std::int64_t encode_us = 0;  // of a job of capture, at any level
  double decode_share = 0;     // of a core, the operator's end of the link, at 30 frames a second
};

// Both 0 where the scene names no other codecs.
[[nodiscard]] PictureCost picture_cost(const drivers::PictureConfig& pictures,
                                       const perception::Intrinsics& camera) noexcept;

}  // namespace tasks
