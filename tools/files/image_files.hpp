// Reads PNG and JPEG files strictly. The container is checked before a decoder sees it
// (drivers/camera/recording/image_header.hpp), so a truncated or huge file gives one message
// and not half an image. The pixel type must be the requested one.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "drivers/camera/recording/image_header.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/result.hpp"

namespace teletact {

inline constexpr int kMaxImageSide = drivers::kMaxImageSide;

// A photograph may say how it was held (EXIF, tag 0x0112). kStored: pixel (0, 0) is the first one
// stored. kUpright: as viewers show it, turned or mirrored, so that width and height may change
// places.
enum class Orientation : std::uint8_t { kStored, kUpright };

// 8 bit colour, PNG or JPEG; grey is taken as colour, an alpha channel is dropped. `name` begins
// each error message.
[[nodiscard]] rt::Result<perception::Image<perception::Rgb>> decode_colour(
    std::span<const std::uint8_t> bytes, const std::string& name,
    Orientation orientation = Orientation::kStored);
// 16 or 8 bit grey PNG.
[[nodiscard]] rt::Result<perception::Image<std::uint16_t>> decode_grey(
    std::span<const std::uint8_t> bytes, const std::string& name);

[[nodiscard]] rt::Result<perception::Image<perception::Rgb>> read_colour(
    const std::string& path, Orientation orientation = Orientation::kStored);
[[nodiscard]] rt::Result<perception::Image<std::uint16_t>> read_grey(const std::string& path);

// A PNG as bytes: 8 bit when every value is below 256, else 16 bit. Fixed settings, so the same
// image gives the same bytes.
[[nodiscard]] std::string encode_labels(perception::ImageView<const std::uint16_t> labels);

}  // namespace teletact
