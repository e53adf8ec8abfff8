// The bytes of a depth frame: a header of kDepthFrameHeader bytes, then the stripes, one after the
// other.
//
// Little-endian: u32 magic "TDS1", u8 kind, u8 mode, u8 step, u8 law, u16 width, u16 height, u32
// seq,
//   u32 bytes of the first stripe, u32 bytes of all stripes, u64 check
// check: rt::Hash64 over the header before it and the stripes and, of a delta, over the check of
// the frame before it: so a delta that is decoded follows the very frame that it was coded after.
#pragma once

#include <cstdint>
#include <span>

#include "drivers/codec/depth_stream.hpp"

namespace drivers::codec {

struct DepthFrameHeader {
  DepthFrameKind kind = DepthFrameKind::kKey;
  DepthMode mode = DepthMode::kLossless;
  DepthNoiseLaw law = DepthNoiseLaw::kStrict;
  int step = 0;
  int width = 0, height = 0;  // px
  std::uint32_t seq = 0;
  std::uint32_t first_bytes = 0, all_bytes = 0;  // of the stripes
  std::uint64_t check = 0;
};

// `frame`: header and stripes; writes the header in front of the stripes, and h.check.
void write_header(DepthFrameHeader& h, std::uint64_t check_before,
                  std::span<std::uint8_t> frame) noexcept;
// kOk, kTruncated or kBadHeader; `frame` must be exactly one frame.
[[nodiscard]] DepthStatus read_header(std::span<const std::uint8_t> frame,
                                      DepthFrameHeader& h) noexcept;
// What write_header() would put there. `check_before` counts for deltas only.
[[nodiscard]] std::uint64_t check_of(const DepthFrameHeader& h, std::uint64_t check_before,
                                     std::span<const std::uint8_t> frame) noexcept;

}  // namespace drivers::codec
