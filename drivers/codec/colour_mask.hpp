// Which pixels of a picture have no colour (perception/geometry/no_colour.hpp), as a comment segment
// of its JPEG: JPEG keeps no exact values. What decodes JPEG passes over it; a picture in which all
// have colour has none.
//
//   0xff 0xfe, u16 big-endian: bytes from here on, "TNC1", u8 form, then
//     form 1   lengths of runs in row order, in turn of pixels that are as expected and that are
//              not, the first may be 0; 7 bits a byte, low first, the top bit says that more follow
//     form 2   a bit a pixel in row order, low first: not as expected; when runs would take more
//   Expected is a colour where there is a reading of depth and none where there is not: what is
//   hidden from the colour camera is little beside the holes of depth, which have no colour either.
//
// Allocation-free, noexcept. Reading takes bytes of anybody: it reads within them and refuses what
// is not one value a pixel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace drivers {

inline constexpr std::size_t kMostColourMaskBytes = 9 + perception::RgbdFrame::kMaxPixels / 8;

// Bytes of the segment; 0 when every pixel has colour. `depth_mm` is of the picture's size, or
// empty: readings everywhere. The picture is at most RgbdFrame's largest.
[[nodiscard]] std::size_t write_colour_mask(
    perception::ImageView<const perception::Rgb> image, std::span<const std::uint16_t> depth_mm,
    std::span<std::uint8_t, kMostColourMaskBytes> out) noexcept;

// Takes the colour off the pixels that the segment of `jpeg` names, if it has one. False: it is
// malformed.
[[nodiscard]] bool apply_colour_mask(std::span<const std::uint8_t> jpeg,
                                     std::span<const std::uint16_t> depth_mm,
                                     perception::ImageView<perception::Rgb> image) noexcept;

}  // namespace drivers
