// What a PNG or JPEG file says of its image, read from its container alone: signature, size, PNG chunks with
// their CRC, JPEG markers up to the end of image. A torn, damaged or huge file ends here in one message, before
// a decoder takes memory for it.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "rt/result.hpp"

namespace drivers {

inline constexpr int kMaxImageSide = 8192;

struct ImageHeader {
  int width = 0, height = 0, bits = 8, channels = 3;
  bool png = false;
};

// `name` begins each error message.
[[nodiscard]] rt::Result<ImageHeader> image_header(std::span<const std::uint8_t> bytes,
                                                   const std::string& name);

// CRC-32 of ISO 3309, as PNG chunks carry it: over type and data.
[[nodiscard]] std::uint32_t png_crc(std::span<const std::uint8_t> bytes);

}  // namespace drivers
