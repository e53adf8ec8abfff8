// The Novint Falcon's wire format: 16 bytes each way, '<', 14 bytes of 'A' + value, '>'.
//
//   byte   host -> device                            device -> host
//   1-4    motor 1, 16-bit two's complement torque,  encoder 1, the same coding
//          four nibbles, lowest first
//   5-8    motor 2                                   encoder 2
//   9-12   motor 3                                   encoder 3
//   13     0x01 home, 0x02 green, 0x04 blue, 0x08    buttons 0x01..0x08, homed 0x10, 0x20, 0x40
//          red LED
//   14     0                                         unknown
//
// Source: the published driver libnifalcon (BSD), read for facts; the protocol has no vendor
// document. One frame out brings one frame in. The framing bytes lie outside the range of the coded
// ones, so a damaged stream is in step again at the next '<'.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace drivers {

inline constexpr std::size_t kFalconFrameSize = 16;
using FalconFrame = std::array<std::uint8_t, kFalconFrameSize>;

struct FalconCommand {
  std::array<std::int16_t, 3> torque_cnt{};
  bool home = false;  // look for the encoders' index marks
  bool red = false, green = false, blue = false;
  friend bool operator==(const FalconCommand&, const FalconCommand&) = default;
};

struct FalconReport {
  std::array<std::int16_t, 3> encoder_cnt{};
  std::uint8_t buttons = 0;  // 4 bits
  std::uint8_t homed = 0;    // 3 bits, one a motor
  std::uint8_t unknown = 0;
  friend bool operator==(const FalconReport&, const FalconReport&) = default;
};

[[nodiscard]] FalconFrame encode(const FalconCommand&) noexcept;
[[nodiscard]] FalconFrame encode(const FalconReport&) noexcept;
// False: a byte is out of its range; `out` is then untouched.
[[nodiscard]] bool decode(const FalconFrame&, FalconCommand& out) noexcept;
[[nodiscard]] bool decode(const FalconFrame&, FalconReport& out) noexcept;

// Cuts a byte stream into frames. Any bytes may come, cut anywhere.
class FalconFramer {
 public:
  // True: this byte ended a frame; it is in frame() until the next push.
  [[nodiscard]] bool push(std::uint8_t byte) noexcept;
  [[nodiscard]] const FalconFrame& frame() const noexcept { return frame_; }
  // Begun frames that were no frame, and bytes outside any.
  [[nodiscard]] std::uint64_t damaged() const noexcept { return damaged_; }
  [[nodiscard]] std::uint64_t stray() const noexcept { return stray_; }
  void reset() noexcept { size_ = 0; }

 private:
  FalconFrame frame_{};
  std::size_t size_ = 0;
  std::uint64_t damaged_ = 0, stray_ = 0;
};

}  // namespace drivers
