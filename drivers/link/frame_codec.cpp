#include "drivers/link/frame_codec.hpp"

#include <cmath>
#include <cstring>

#include "drivers/link/depth_codec.hpp"
#include "rt/hash.hpp"

namespace drivers {

using perception::Intrinsics;
using perception::RgbdFrame;

namespace {

constexpr std::uint32_t kFrameMagic = 0x32465454;  // "TTF2"

bool plausible(const Intrinsics& k) noexcept {
  const auto within = [](double v, double lo, double hi) { return v >= lo && v <= hi; };
  return within(k.fx, 1, 1e5) && within(k.fy, 1, 1e5) && within(k.cx, -1e5, 1e5) &&
         within(k.cy, -1e5, 1e5) && k.width > 0 && k.width <= RgbdFrame::kMaxWidth &&
         k.height > 0 && k.height <= RgbdFrame::kMaxHeight;
}

std::size_t pixels(const Intrinsics& k) noexcept {
  return static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height);
}

template <class T>
void put(std::uint8_t*& at, T v) noexcept {
  for (std::size_t i = 0; i < sizeof(T); ++i) *at++ = static_cast<std::uint8_t>(v >> (8 * i));
}
void put(std::uint8_t*& at, double v) noexcept {
  std::uint64_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  put(at, bits);
}
void put(std::uint8_t*& at, float v) noexcept {
  std::uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  put(at, bits);
}
template <class T>
T get(const std::uint8_t*& at) noexcept {
  std::uint64_t v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) v |= static_cast<std::uint64_t>(*at++) << (8 * i);
  return static_cast<T>(v);
}
double get_double(const std::uint8_t*& at) noexcept {
  const auto bits = get<std::uint64_t>(at);
  double v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
}

float get_float(const std::uint8_t*& at) noexcept {
  const auto bits = get<std::uint32_t>(at);
  float v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
}

// Bytes of the joints on the wire; a robot without any pays none.
std::size_t joint_bytes(int count) noexcept {
  return count > 0 ? 8 + 8 * static_cast<std::size_t>(count) : 0;
}
void put_joints(std::uint8_t*& at, const perception::JointAngles& q) noexcept {
  if (q.count <= 0) return;
  put(at, q.error);
  put(at, q.age_s);
  for (std::size_t i = 0; i < static_cast<std::size_t>(q.count); ++i) {
    put(at, q.position[i]);
    put(at, q.speed[i]);
  }
}
perception::JointAngles get_joints(int count, const std::uint8_t* at) noexcept {
  perception::JointAngles q;
  q.count = count;
  if (count == 0) return q;
  q.error = get_float(at);
  q.age_s = get_float(at);
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    q.position[i] = get_float(at);
    q.speed[i] = get_float(at);
  }
  return q;
}

std::uint64_t check_of(const std::uint8_t* header, std::span<const std::uint8_t> rest) noexcept {
  rt::Hash64 h;
  h.bytes(header, kWireHeader - 8);
  h.bytes(rest.data(), rest.size());
  return h.digest();
}

}  // namespace

const char* to_text(FrameStatus s) noexcept {
  switch (s) {
    case FrameStatus::kOk:
      return "ok";
    case FrameStatus::kWithoutColour:
      return "no colour";
    case FrameStatus::kTruncated:
      return "truncated";
    case FrameStatus::kBadHeader:
      return "bad header";
    case FrameStatus::kBadCheck:
      return "check does not fit";
    case FrameStatus::kBadDepth:
      return "bad depth";
    case FrameStatus::kNoRoom:
      return "no room";
  }
  return "?";
}

FrameStatus encode(const RgbdFrame& frame, rt::Box box, bool with_colour,
                   FrameCodecScratch& scratch, EncodedFrame& out) noexcept {
  if (!plausible(frame.intrinsics)) return FrameStatus::kBadHeader;
  // Joints that say nothing are left out: whoever needs them sees that there are none.
  out.joints = frame.joints.plausible() ? frame.joints : perception::JointAngles{};
  out.exposure = rt::to_stamp(frame.exposure, box);
  out.seq = frame.seq;
  out.intrinsics = frame.intrinsics;
  out.has_colour = false;
  out.colour_size = 0;
  out.depth_size =
      static_cast<std::uint32_t>(encode_depth({frame.depth_mm.data(), pixels(frame.intrinsics)},
                                              {out.bytes.data(), EncodedFrame::kMaxDepthBytes}));
  if (!with_colour || !frame.has_colour) return FrameStatus::kOk;
  const std::size_t size = scratch.colour.encode(
      frame.rgb(), {out.bytes.data() + out.depth_size, EncodedFrame::kMaxColourBytes},
      {frame.depth_mm.data(), pixels(frame.intrinsics)});
  if (size == 0) return FrameStatus::kWithoutColour;
  out.has_colour = true;
  out.colour_size = static_cast<std::uint32_t>(size);
  return FrameStatus::kOk;
}

FrameStatus decode(const EncodedFrame& frame, rt::Time exposure, FrameCodecScratch& scratch,
                   RgbdFrame& out) noexcept {
  if (!plausible(frame.intrinsics) || !frame.joints.plausible() ||
      frame.depth_size > EncodedFrame::kMaxDepthBytes ||
      frame.colour_size > EncodedFrame::kMaxColourBytes) {
    return FrameStatus::kBadHeader;
  }
  out.exposure = exposure;
  out.seq = frame.seq;
  out.intrinsics = frame.intrinsics;
  out.joints = frame.joints;
  out.has_colour = false;
  if (!decode_depth(frame.depth(), {out.depth_mm.data(), pixels(frame.intrinsics)})) {
    return FrameStatus::kBadDepth;
  }
  if (!frame.has_colour) return FrameStatus::kOk;
  if (!scratch.colour.decode(frame.colour(), out.rgb(),
                             {out.depth_mm.data(), pixels(frame.intrinsics)}))
    return FrameStatus::kWithoutColour;
  out.has_colour = true;
  return FrameStatus::kOk;
}

std::size_t wire_size(const EncodedFrame& f) noexcept {
  return kWireHeader + joint_bytes(f.joints.count) + f.depth_size + f.colour_size;
}

std::size_t write_wire(const EncodedFrame& f, std::span<std::uint8_t> out) noexcept {
  if (out.size() < wire_size(f)) return 0;
  std::uint8_t* at = out.data();
  put(at, kFrameMagic);
  put(at, static_cast<std::uint8_t>(f.exposure.box));
  put(at, static_cast<std::uint8_t>(f.has_colour ? 1 : 0));
  put(at, static_cast<std::uint16_t>(f.intrinsics.width));
  put(at, static_cast<std::uint16_t>(f.intrinsics.height));
  put(at, static_cast<std::uint8_t>(f.joints.count));
  put(at, std::uint8_t{0});
  put(at, f.depth_size);
  put(at, f.colour_size);
  put(at, f.seq);
  put(at, static_cast<std::uint64_t>(f.exposure.ns));
  put(at, f.intrinsics.fx);
  put(at, f.intrinsics.fy);
  put(at, f.intrinsics.cx);
  put(at, f.intrinsics.cy);
  std::uint8_t* const check_at = at;
  at += 8;
  put_joints(at, f.joints);
  std::memcpy(at, f.bytes.data(), f.depth_size + f.colour_size);
  at = check_at;
  put(at, check_of(out.data(), out.subspan(kWireHeader, wire_size(f) - kWireHeader)));
  return wire_size(f);
}

FrameStatus read_wire(std::span<const std::uint8_t> in, EncodedFrame& out) noexcept {
  if (in.size() < kWireHeader) return FrameStatus::kTruncated;
  const std::uint8_t* at = in.data();
  if (get<std::uint32_t>(at) != kFrameMagic) return FrameStatus::kBadHeader;
  const auto box = get<std::uint8_t>(at), flags = get<std::uint8_t>(at);
  Intrinsics k;
  k.width = get<std::uint16_t>(at);
  k.height = get<std::uint16_t>(at);
  const auto joints = get<std::uint8_t>(at), reserved = get<std::uint8_t>(at);
  const auto depth_size = get<std::uint32_t>(at), colour_size = get<std::uint32_t>(at);
  const auto seq = get<std::uint64_t>(at);
  const auto exposure_ns = static_cast<std::int64_t>(get<std::uint64_t>(at));
  k.fx = get_double(at), k.fy = get_double(at), k.cx = get_double(at), k.cy = get_double(at);
  const auto check = get<std::uint64_t>(at);
  if (box > 1 || flags > 1 || reserved != 0 || joints > perception::JointAngles::kMost ||
      !plausible(k) || depth_size > EncodedFrame::kMaxDepthBytes ||
      colour_size > EncodedFrame::kMaxColourBytes || (flags == 0) != (colour_size == 0)) {
    return FrameStatus::kBadHeader;
  }
  const std::size_t size = std::size_t{depth_size} + colour_size, before = joint_bytes(joints);
  if (in.size() - kWireHeader < before + size) return FrameStatus::kTruncated;
  if (check_of(in.data(), in.subspan(kWireHeader, before + size)) != check)
    return FrameStatus::kBadCheck;
  const auto blobs = in.subspan(kWireHeader + before, size);
  const auto q = get_joints(joints, in.data() + kWireHeader);
  if (!q.plausible()) return FrameStatus::kBadHeader;
  out.exposure = {static_cast<rt::Box>(box), exposure_ns};
  out.seq = seq;
  out.intrinsics = k;
  out.joints = q;
  out.has_colour = flags == 1;
  out.depth_size = depth_size;
  out.colour_size = colour_size;
  std::memcpy(out.bytes.data(), blobs.data(), blobs.size());
  return FrameStatus::kOk;
}

}  // namespace drivers
