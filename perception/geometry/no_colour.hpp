// Where an image has no colour. A colour camera beside the depth camera does not see every depth pixel (hidden by
// parallax, outside its image), and what is not known must not be taken for a colour.
//
// Exactly (0, 0, 0) is no colour. Whoever makes a frame lifts real black to (1, 1, 1), 0.3 of CIELAB's L, which
// no sensor resolves. Against a mask beside the colours: it costs no bytes in a frame (a bit a pixel is
// 38 KiB), no further argument wherever an image is passed, copied or cut out, and none of a load beside the colour's
// own in the voxel update; a frame can not carry a mask that belongs to another one. A frame made without knowing
// of it says of its blacks that nothing is known there, which costs little, instead of the other way round. JPEG
// keeps no exact values, so on the link a mask does go beside the picture (drivers/codec/colour_mask.hpp).
#pragma once

#include <cstddef>

#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace perception {

inline constexpr Rgb kNoColour{0, 0, 0};
inline constexpr Rgb kBlack{1, 1, 1};          // the darkest colour
inline constexpr Rgb kNeutral{128, 128, 128};  // shows what was never coloured

[[nodiscard]] constexpr bool has_colour(Rgb c) noexcept { return (c.r | c.g | c.b) != 0; }
[[nodiscard]] constexpr Rgb lifted(Rgb c) noexcept { return has_colour(c) ? c : kBlack; }

inline void lift_black(ImageView<Rgb> image) noexcept {
  for (int v = 0; v < image.height; ++v) {
    Rgb* row = image.row(v);
    for (int u = 0; u < image.width; ++u) row[u] = lifted(row[u]);
  }
}

// False: all of n pixels in a row have colour. True also where three zeros follow each other across pixels: a
// quick look, by bytes, before the exact one.
[[nodiscard]] inline bool may_lack_colour(const Rgb* pixels, int n) noexcept {
  static_assert(sizeof(Rgb) == 3);
  const auto* p = reinterpret_cast<const unsigned char*>(pixels);
  const std::ptrdiff_t last = static_cast<std::ptrdiff_t>(3) * n - 2;
  unsigned char any = 0;
  for (std::ptrdiff_t i = 0; i < last; ++i)
    any = static_cast<unsigned char>(any | ((p[i] | p[i + 1] | p[i + 2]) == 0 ? 1 : 0));
  return any != 0;
}

// The word of a voxel's colour: r | g << 8 | b << 16, and how often a reading ended there (bits 24 to 27) and how
// often it brought a colour (28 to 31), both counted to 15. Never coloured: r, g, b are 0 and say nothing.
inline constexpr std::uint32_t kMostCounted = 15;
[[nodiscard]] constexpr std::uint32_t readings_of(std::uint32_t word) noexcept {
  return (word >> 24U) & kMostCounted;
}
[[nodiscard]] constexpr std::uint32_t coloured_readings_of(std::uint32_t word) noexcept {
  return word >> 28U;
}
[[nodiscard]] constexpr Rgb colour_of(std::uint32_t word) noexcept {
  return {static_cast<std::uint8_t>(word & 0xffU), static_cast<std::uint8_t>((word >> 8U) & 0xffU),
          static_cast<std::uint8_t>((word >> 16U) & 0xffU)};
}

}  // namespace perception
