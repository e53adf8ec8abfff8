// Checks the container of a PNG or JPEG file and reads its image size: signature, PNG chunks with
// their CRC, JPEG markers up to the end of image. A truncated, damaged or huge file is refused here
// with one message, before a decoder allocates memory for it.
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
