// Where an image has no colour. A colour camera beside the depth camera does not see every depth
// pixel (hidden by parallax, outside its image), and what is not known must not be taken for a
// colour.
//
// Exactly (0, 0, 0) means no colour. The maker of a frame must lift real black to (1, 1, 1): 0.3 of
// CIELAB's L, which no sensor resolves. Advantages over a separate mask:
//   - no bytes in a frame (a bit a pixel is 38 KiB), no further argument where images are passed,
//     copied or cropped, and no second load in the voxel update;
//   - a frame can not carry the mask of another frame;
//   - a frame whose maker does not know the rule only loses its blacks, which costs little.
// JPEG does not keep exact values, so on the link a mask travels beside the picture
// (drivers/codec/colour_mask.hpp).
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

// Quick test by bytes, before the exact one. False: all n pixels of the row have colour. True also
// if three zero bytes follow each other across two pixels.
[[nodiscard]] inline bool may_lack_colour(const Rgb* pixels, int n) noexcept {
  static_assert(sizeof(Rgb) == 3);
  const auto* p = reinterpret_cast<const unsigned char*>(pixels);
  const std::ptrdiff_t last = static_cast<std::ptrdiff_t>(3) * n - 2;
  unsigned char any = 0;
  for (std::ptrdiff_t i = 0; i < last; ++i)
    any = static_cast<unsigned char>(any | ((p[i] | p[i + 1] | p[i + 2]) == 0 ? 1 : 0));
  return any != 0;
}

// The colour word of a voxel: r | g << 8 | b << 16, the number of readings that ended there (bits
// 24 to 27) and of those with colour (28 to 31), both counted to 15. If never coloured, r, g and b
// are 0 and void.
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
