// Lossless depth codec after Wilson, "Fast Lossless Depth Image Compression" (ISS 2017), own code:
// the image in row order is a chain of (number of empty pixels, number of readings, differences of
// the readings); numbers are little groups of 3 bits with a continuation bit (nibbles).
//
// First byte: 1 = coded so, 2 = plain 16-bit little-endian (used when coding would not shrink it),
// so an image of n pixels never takes more than 2 n + kOverhead bytes. Allocation-free, noexcept.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace drivers {

inline constexpr std::size_t kDepthOverhead = 16;
[[nodiscard]] constexpr std::size_t max_depth_bytes(std::size_t pixels) noexcept {
  return 2 * pixels + kDepthOverhead;
}

// Bytes written, 0 when `out` is shorter than max_depth_bytes(depth.size()).
[[nodiscard]] std::size_t encode_depth(std::span<const std::uint16_t> depth_mm,
                                       std::span<std::uint8_t> out) noexcept;

// Reads only within `in`, writes only within `depth_mm`; false when the bytes do not describe
// exactly depth_mm.size() pixels (the content of depth_mm is then unspecified).
[[nodiscard]] bool decode_depth(std::span<const std::uint8_t> in,
                                std::span<std::uint16_t> depth_mm) noexcept;

}  // namespace drivers
