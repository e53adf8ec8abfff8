// Lossless compression of one block of the map, for blocks far from the camera and for map files.
// The same block always gives the same bytes.
//
//   flags      bit 0: there are colours; bit 1: there are labels
//   free       of the 8 words: which are not 0, which are all ones (one bit each), then the others
//              as they are
//   words      512 bits: which are not 0; of those distance (against the plane through the
//              neighbours that came before), then weight (against the one before)
//   colours    512 bits: which are not 0; of those red, green, blue, readings, readings without
//              colour (geometry/no_colour.hpp), each against the one before
//   labels     label, weight of all 512, each against the one before
//
// Numbers are residuals, sign folded into bit 0, in groups of 16: 5 bits of width, then so many
// bits each. Decoding accepts any bytes and never reads beyond them. It refuses values that the map
// can not hold (weights above their cap, a distance of -32768, more coloured readings than
// readings, a colour without one, labels above kMostLabel) and bytes that are left over.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "perception/segmentation/label_vote.hpp"

namespace perception {

struct BlockImage {
  std::array<std::uint32_t, 512> words{}, colours{};
  std::array<std::uint64_t, 8> free{};
  std::array<LabelVoxel, 512> labels{};
  bool labelled = false;
  friend bool operator==(const BlockImage&, const BlockImage&) = default;
};

inline constexpr std::size_t kMostBlockBytes = 7168;    // no block takes more
inline constexpr std::size_t kLeastBlockBytes = 67;     // nor less
inline constexpr std::uint32_t kMostRawWeight = 32640;  // 255 observations

// Returns the bytes written. `labels` is empty or 512.
std::size_t encode_block(std::span<const std::uint32_t, 512> words,
                         std::span<const std::uint32_t, 512> colours,
                         std::span<const std::uint64_t, 8> free, std::span<const LabelVoxel> labels,
                         std::span<std::uint8_t, kMostBlockBytes> out) noexcept;
// False: not the bytes of one block; `out` is then void.
[[nodiscard]] bool decode_block(std::span<const std::uint8_t> bytes, BlockImage& out) noexcept;

}  // namespace perception
