// Colour as baseline JPEG through OpenCV's imgcodecs, at full or half resolution.
//
// OpenCV and libjpeg allocate; that is why capture is a firm task. Nothing is thrown out of here.
// The decoder looks at the JPEG's own size before it lets the library see it, so a damaged header
// can not ask for gigabytes.
//
// Pixels without colour (perception/geometry/no_colour.hpp) are coded as what stands left of them, so that none of
// their neighbours changes, and named beside the picture (colour_mask.hpp): they come back exactly.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "config/schema.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [codec].
struct ColourCodecConfig {
  int quality = 60;  // of JPEG, 1..100
  bool half = true;  // half the width and height: a quarter of the bytes and of the time
  void describe(config::Section& s);
};

class ColourCodec {
 public:
  // Codes one picture to make the library set itself up. Throws std::runtime_error if it can not.
  ColourCodec(rt::NonRealtime&, const ColourCodecConfig& config);
  ~ColourCodec();
  ColourCodec(const ColourCodec&) = delete;
  ColourCodec& operator=(const ColourCodec&) = delete;

  // Bytes written; 0 when the library failed or the result does not fit. depth_mm, of the picture's size or empty,
  // makes the mask small; decode() has to be given the same.
  [[nodiscard]] std::size_t encode(perception::ImageView<const perception::Rgb> image,
                                   std::span<std::uint8_t> out,
                                   std::span<const std::uint16_t> depth_mm = {}) noexcept;
  // Decodes a JPEG of the size of `image`, or of half of it (rounded up), into `image`.
  [[nodiscard]] bool decode(std::span<const std::uint8_t> in,
                            perception::ImageView<perception::Rgb> image,
                            std::span<const std::uint16_t> depth_mm = {}) noexcept;

 private:
  struct State;  // OpenCV's images and buffers
  std::unique_ptr<State> state_;
};

// Width and height of a baseline JPEG; {0, 0} when it is none, or its header contradicts itself.
struct JpegSize {
  int width = 0, height = 0;
};
[[nodiscard]] JpegSize jpeg_size(std::span<const std::uint8_t> in) noexcept;

}  // namespace drivers
