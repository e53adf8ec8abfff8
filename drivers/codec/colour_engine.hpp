// The libraries behind colour_stream.hpp: one picture to a payload and back.
// Nobody else includes it.
#pragma once

#include <memory>

#include "drivers/codec/colour_stream.hpp"

namespace drivers {

class ColourEncodeEngine {
 public:
  virtual ~ColourEncodeEngine() = default;
  // The demand is within its ranges.
  [[nodiscard]] virtual ColourEncoder::Coded encode(
      perception::ImageView<const perception::Rgb> picture, const ColourDemand& demand,
      std::span<std::uint8_t> out) noexcept = 0;
};

class ColourDecodeEngine {
 public:
  virtual ~ColourDecodeEngine() = default;
  // The payload must be of a picture of exactly this size. False: it is not, or is damaged.
  [[nodiscard]] virtual bool decode(std::span<const std::uint8_t> payload, bool key,
                                    perception::ImageView<perception::Rgb> picture) noexcept = 0;
};

// They throw std::runtime_error when the library can not be set up.
[[nodiscard]] std::unique_ptr<ColourEncodeEngine> make_jpeg_encoder();
[[nodiscard]] std::unique_ptr<ColourDecodeEngine> make_jpeg_decoder();
// Null where H.264 is not built in.
[[nodiscard]] std::unique_ptr<ColourEncodeEngine> make_h264_encoder(
    const ColourStreamConfig& config, int width, int height);
[[nodiscard]] std::unique_ptr<ColourDecodeEngine> make_h264_decoder();

}  // namespace drivers
