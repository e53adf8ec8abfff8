#include "tasks/graph/picture_cost.hpp"

#include <cmath>

namespace tasks {

namespace {

// A frame of depth on one thread: the limits of `teletact bench codec`, less what lossless depth
// takes.
constexpr std::int64_t kDepthEncode_us = 5500 - 600, kDepthDecode_us = 3200 - 400;
// A picture of H.264 at half size, less what JPEG takes.
constexpr std::int64_t kH264Encode_us = 1500, kH264Decode_us = 500;
constexpr double kFrames_per_us = 30e-6;
constexpr double kPixels = 512 * 424;

}  // namespace

PictureCost picture_cost(const drivers::PictureConfig& pictures,
                         const perception::Intrinsics& camera) noexcept {
  PictureCost cost;
  std::int64_t decode_us = 0;
  if (pictures.depth_codec != "lossless") {
    cost.encode_us += kDepthEncode_us;
    decode_us += kDepthDecode_us;
  }
  if (pictures.colour_codec == "h264") {
    cost.encode_us += kH264Encode_us;
    decode_us += kH264Decode_us;
  }
  const double size = static_cast<double>(camera.width) * camera.height / kPixels;
  cost.encode_us = std::llround(size * static_cast<double>(cost.encode_us));
  cost.decode_share = size * kFrames_per_us * static_cast<double>(decode_us);
  return cost;
}

}  // namespace tasks
