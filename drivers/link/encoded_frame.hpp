// An RGB-D frame as it crosses the link: a header, the joint angles at the exposure, and two blobs,
// depth of a codec that the header names (frame_codec.hpp) and colour (colour_stream.hpp). Fixed
// capacity, so it lives in a prefaulted channel slot; on the wire it has only its real length.
//
// Wire form, little-endian (write_wire / read_wire), kWireHeader bytes, then the joints, then the
// blobs:
//   u32 magic "TTF3", u8 box, u8 flags (1 = colour, 2 = needs the frame before it,
//   4 x Spared::rungs, 32 = kLate), u16 width, u16
//   height, u8 joints, u8 DepthCodecId, u32 depth size, u32 colour
//   size, u64 seq, i64 exposure ns, 4 x f64 fx fy cx cy, u64 check (rt::Hash64 over the header
//   before it, the joints and the blobs)
// and where there are joints: f32 error, f32 age s, and of each f32 position, f32 speed.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/time.hpp"

namespace drivers {

enum class DepthCodecId : std::uint8_t {
  kLossless,  // depth_codec.hpp: each frame alone
  kStream,    // drivers/codec/depth_stream.hpp
};

// What the sending end spares the road at this frame, and why (frame_asker.hpp).
struct Spared {
  enum class Why : std::uint8_t {
    kNo,
    kBusy,  // single frames keep the road busy nearly all the time
    kLate,  // its round trip has grown
  };
  // 1 to 3: quality steps coarser; 4, 5: three steps, and 24 or 20 frames a second.
  std::uint8_t rungs = 0;
  Why why = Why::kNo;
  static constexpr std::uint8_t kMost = 5;
  bool operator==(const Spared&) const = default;
};

struct EncodedFrame {
  // Of the longest any codec may make.
  static constexpr std::size_t kMaxDepthBytes = 2 * perception::RgbdFrame::kMaxPixels + 96;
  static constexpr std::size_t kMaxColourBytes = std::size_t{256} * 1024;
  static constexpr std::size_t kCapacity = kMaxDepthBytes + kMaxColourBytes;

  rt::Stamp exposure{};   // middle of the exposure, clock of the box that has the camera
  std::uint64_t seq = 0;  // the camera's frame number
  perception::Intrinsics intrinsics{};
  bool has_colour = false;
  bool needs_previous =
      false;  // can be decoded by who decoded the frame that was encoded before it
  DepthCodecId depth_codec = DepthCodecId::kLossless;
  Spared spared{};
  std::uint64_t demand = 0;  // that it answers (FrameDemand::seq); not on the wire
  perception::JointAngles joints{};
  std::uint32_t depth_size = 0, colour_size = 0;
  std::array<std::uint8_t, kCapacity> bytes{};  // depth, then colour

  [[nodiscard]] std::span<const std::uint8_t> depth() const noexcept {
    return {bytes.data(), depth_size};
  }
  [[nodiscard]] std::span<const std::uint8_t> colour() const noexcept {
    return {bytes.data() + depth_size, colour_size};
  }
};

enum class FrameStatus : std::uint8_t {
  kOk,
  kWithoutColour,  // depth is good; colour could not be coded or decoded and was left out
  kTruncated,      // fewer bytes than the header asks for
  kBadHeader,      // magic, size, intrinsics or joints outside what a robot can have
  kBadCheck,       // bytes changed on the way
  kBadDepth,       // the depth blob is not one of ours, or of a codec that was not set up
  kNeedsKey,       // it needs a frame that was not decoded here
  kNoRoom,         // destination too small
};
[[nodiscard]] const char* to_text(FrameStatus s) noexcept;

inline constexpr std::size_t kWireHeader = 76;
inline constexpr std::size_t kMaxJointBytes = 8 + 8 * std::size_t{perception::JointAngles::kMost};
inline constexpr std::size_t kMaxWire = kWireHeader + kMaxJointBytes + EncodedFrame::kCapacity;
[[nodiscard]] std::size_t wire_size(const EncodedFrame& frame) noexcept;
// Bytes written; 0 when `out` is shorter than wire_size(). `spared`: at the moment of sending,
// which is not known when a frame is encoded; the frame's own is not looked at.
std::size_t write_wire(const EncodedFrame& frame, std::span<std::uint8_t> out,
                       Spared spared = {}) noexcept;
// Copies only what the header and the check vouch for; `out` is untouched on any status but kOk.
[[nodiscard]] FrameStatus read_wire(std::span<const std::uint8_t> in, EncodedFrame& out) noexcept;

}  // namespace drivers
