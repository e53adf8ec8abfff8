#include "drivers/link/frame_codec.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "drivers/link/depth_codec.hpp"
#include "drivers/link/wire.hpp"
#include "rt/hash.hpp"

namespace drivers {

using perception::Intrinsics;
using perception::RgbdFrame;

namespace {

static_assert(EncodedFrame::kMaxDepthBytes >= max_depth_frame_bytes(RgbdFrame::kMaxPixels));
static_assert(EncodedFrame::kMaxDepthBytes >= max_depth_bytes(RgbdFrame::kMaxPixels));
constexpr auto kLastDepthCodec = static_cast<unsigned>(DepthCodecId::kStream);

constexpr std::uint32_t kFrameMagic = 0x33465454;  // "TTF3"

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
    case FrameStatus::kNeedsKey:
      return "needs a frame that was lost";
    case FrameStatus::kNoRoom:
      return "no room";
  }
  return "?";
}

namespace {

DepthMode mode_of(const std::string& name) noexcept {
  for (const DepthMode m : {DepthMode::kFaithful, DepthMode::kQuiet, DepthMode::kMoving})
    if (name == to_text(m)) return m;
  return name == "auto" ? DepthMode::kQuiet : DepthMode::kLossless;
}

FrameStatus encode_depth_of(const RgbdFrame& frame, FrameCodecScratch& scratch,
                            const FrameDemand& demand, EncodedFrame& out) noexcept {
  const std::span<const std::uint16_t> depth{frame.depth_mm.data(), pixels(frame.intrinsics)};
  const std::span<std::uint8_t> room{out.bytes.data(), EncodedFrame::kMaxDepthBytes};
  out.needs_previous = false;
  if (!scratch.depth_encoder) {
    out.depth_codec = DepthCodecId::kLossless;
    out.depth_size = static_cast<std::uint32_t>(encode_depth(depth, room));
    return FrameStatus::kOk;
  }
  if (scratch.depth_motion) scratch.depth_mode = scratch.depth_motion->judge(depth);
  const int fine = scratch.depth_step < 0
                       ? default_depth_step(scratch.depth_mode, scratch.depth_law)
                       : scratch.depth_step;
  DepthFrameInfo info;
  const DepthDemand how{scratch.depth_mode, std::min(fine + demand.coarser, kDepthSteps - 1),
                        demand.key != 0};
  if (scratch.depth_encoder->encode(depth, how, room, info) != DepthStatus::kOk)
    return FrameStatus::kBadHeader;
  out.depth_codec = DepthCodecId::kStream;
  out.depth_size = info.bytes;
  out.needs_previous = info.kind != DepthFrameKind::kKey;
  return FrameStatus::kOk;
}

// Bytes; 0: the picture could not be coded.
std::size_t encode_colour_of(const RgbdFrame& frame, FrameCodecScratch& scratch,
                             const FrameDemand& demand, EncodedFrame& out) noexcept {
  const std::span<const std::uint16_t> depth{frame.depth_mm.data(), pixels(frame.intrinsics)};
  const std::span<std::uint8_t> room{out.bytes.data() + out.depth_size,
                                     EncodedFrame::kMaxColourBytes};
  if (!scratch.colour_encoder) return 0;
  ColourDemand how = scratch.colour_demand;
  // A slow line is depth's first.
  if (demand.rate_kbit_per_s > 0)
    how.rate_kbit_s = std::min(how.rate_kbit_s, static_cast<int>(demand.rate_kbit_per_s / 5));
  how.key = scratch.colour_key_due;
  const auto coded = scratch.colour_encoder->encode(frame.rgb(), depth, how, room);
  if (coded.status != ColourStatus::kOk) return 0;
  if (coded.key) scratch.colour_key_due = false;
  out.needs_previous = out.needs_previous || !coded.key;
  return coded.bytes;
}

bool decode_colour_of(const EncodedFrame& frame, FrameCodecScratch& scratch,
                      RgbdFrame& out) noexcept {
  const std::span<const std::uint16_t> depth{out.depth_mm.data(), pixels(frame.intrinsics)};
  if (!scratch.colour_decoder) return false;
  const bool ok =
      scratch.colour_decoder->decode(frame.colour(), depth, out.rgb()) == ColourStatus::kOk;
  // Of pictures that stand alone the next one is as good as a key.
  scratch.colour_wants_key = scratch.colour_chained && !ok;
  return ok;
}

FrameStatus decode_depth_of(const EncodedFrame& frame, FrameCodecScratch& scratch,
                            RgbdFrame& out) noexcept {
  const std::span<std::uint16_t> depth{out.depth_mm.data(), pixels(frame.intrinsics)};
  if (frame.depth_codec == DepthCodecId::kLossless)
    return decode_depth(frame.depth(), depth) ? FrameStatus::kOk : FrameStatus::kBadDepth;
  if (!scratch.depth_decoder) return FrameStatus::kBadDepth;
  DepthFrameInfo info;
  switch (scratch.depth_decoder->decode(frame.depth(), depth, info)) {
    case DepthStatus::kOk:
      return FrameStatus::kOk;
    case DepthStatus::kNeedsKey:
      return FrameStatus::kNeedsKey;
    default:
      return FrameStatus::kBadDepth;
  }
}

}  // namespace

FrameCodecScratch::FrameCodecScratch(rt::NonRealtime& nrt, const ColourCodecConfig& jpeg) {
  colour_demand.quality = jpeg.quality;
  ColourStreamConfig c;
  c.half = jpeg.half;
  colour_encoder = make_colour_encoder(nrt, c, RgbdFrame::kMaxWidth, RgbdFrame::kMaxHeight);
  colour_decoder.emplace(nrt, false);
}

FrameCodecScratch::FrameCodecScratch(rt::NonRealtime& nrt, const ColourCodecConfig& jpeg,
                                     const PictureConfig& pictures, const Intrinsics& camera,
                                     CodecEnd end)
    : depth_mode(mode_of(pictures.depth_codec)),
      depth_law(pictures.depth_noise == "lenient" ? DepthNoiseLaw::kLenient
                                                  : DepthNoiseLaw::kStrict),
      depth_step(pictures.depth_step),
      colour_chained(pictures.colour_codec == "h264"),
      with_colour(pictures.colour_codec != "none") {
  const bool encodes = end == CodecEnd::kEncodes;
  colour_demand.quality = jpeg.quality;
  colour_demand.rate_kbit_s = pictures.colour_rate_kbit_per_s;
  if (with_colour) {
    ColourStreamConfig c;
    c.method = pictures.colour_codec;
    c.half = jpeg.half;
    if (!encodes)
      colour_decoder.emplace(nrt, colour_chained);
    else if (colour_chained)
      colour_encoder = make_colour_encoder(nrt, c, camera.width, camera.height);
    else
      colour_encoder = make_colour_encoder(nrt, c, RgbdFrame::kMaxWidth, RgbdFrame::kMaxHeight);
  }
  if (depth_mode == DepthMode::kLossless) return;
  const DepthStreamConfig c{camera.width, camera.height, depth_law};
  if (encodes && pictures.depth_codec == "auto") depth_motion.emplace(nrt, c);
  if (encodes)
    depth_encoder.emplace(nrt, c);
  else
    depth_decoder.emplace(nrt, c);
}

void FrameCodecScratch::restart() noexcept {
  if (depth_encoder) depth_encoder->restart();
  colour_key_due = true;
}

FrameStatus encode(const RgbdFrame& frame, rt::Box box, bool with_colour,
                   FrameCodecScratch& scratch, EncodedFrame& out,
                   const FrameDemand& demand) noexcept {
  if (!plausible(frame.intrinsics)) return FrameStatus::kBadHeader;
  if (const auto status = encode_depth_of(frame, scratch, demand, out); status != FrameStatus::kOk)
    return status;
  // Joints that say nothing are left out: whoever needs them sees that there are none.
  out.joints = frame.joints.plausible() ? frame.joints : perception::JointAngles{};
  out.exposure = rt::to_stamp(frame.exposure, box);
  out.seq = frame.seq;
  out.intrinsics = frame.intrinsics;
  out.demand = demand.seq;
  out.has_colour = false;
  out.colour_size = 0;
  if (demand.key != 0) scratch.colour_key_due = true;
  // A key brings its colour along, also at a level that leaves it out of most frames.
  with_colour = with_colour || (scratch.colour_chained && scratch.colour_key_due);
  if (!with_colour || !frame.has_colour || !scratch.with_colour) return FrameStatus::kOk;
  const std::size_t size = encode_colour_of(frame, scratch, demand, out);
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
  if (const auto status = decode_depth_of(frame, scratch, out); status != FrameStatus::kOk)
    return status;
  if (!frame.has_colour) return FrameStatus::kOk;
  if (!decode_colour_of(frame, scratch, out)) return FrameStatus::kWithoutColour;
  out.has_colour = true;
  return FrameStatus::kOk;
}

std::size_t wire_size(const EncodedFrame& f) noexcept {
  return kWireHeader + joint_bytes(f.joints.count) + f.depth_size + f.colour_size;
}

namespace {

// Flags of a frame: colour, needs the one before it, what is spared and why.
std::uint8_t flags_of(const EncodedFrame& f, Spared spared) noexcept {
  const unsigned rungs = std::min(spared.rungs, Spared::kMost);
  const bool late = rungs > 0 && spared.why == Spared::Why::kLate;
  return static_cast<std::uint8_t>((f.has_colour ? 1U : 0U) | (f.needs_previous ? 2U : 0U) |
                                   rungs << 2U | (late ? 32U : 0U));
}

bool good_flags(unsigned flags) noexcept {
  const unsigned rungs = flags >> 2U & 7U;
  return flags < 64 && rungs <= Spared::kMost && (rungs > 0 || (flags & 32U) == 0);
}

Spared spared_of(unsigned flags) noexcept {
  const auto rungs = static_cast<std::uint8_t>(flags >> 2U & 7U);
  if (rungs == 0) return {};
  return {rungs, (flags & 32U) != 0 ? Spared::Why::kLate : Spared::Why::kBusy};
}

}  // namespace

std::size_t write_wire(const EncodedFrame& f, std::span<std::uint8_t> out, Spared spared) noexcept {
  if (out.size() < wire_size(f)) return 0;
  std::uint8_t* at = out.data();
  put(at, kFrameMagic);
  put(at, static_cast<std::uint8_t>(f.exposure.box));
  put(at, flags_of(f, spared));
  put(at, static_cast<std::uint16_t>(f.intrinsics.width));
  put(at, static_cast<std::uint16_t>(f.intrinsics.height));
  put(at, static_cast<std::uint8_t>(f.joints.count));
  put(at, static_cast<std::uint8_t>(f.depth_codec));
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
  const auto joints = get<std::uint8_t>(at), codec = get<std::uint8_t>(at);
  const auto depth_size = get<std::uint32_t>(at), colour_size = get<std::uint32_t>(at);
  const auto seq = get<std::uint64_t>(at);
  const auto exposure_ns = static_cast<std::int64_t>(get<std::uint64_t>(at));
  k.fx = get_double(at), k.fy = get_double(at), k.cx = get_double(at), k.cy = get_double(at);
  const auto check = get<std::uint64_t>(at);
  if (box > 1 || !good_flags(flags) || codec > kLastDepthCodec ||
      joints > perception::JointAngles::kMost || !plausible(k) || !plausible_instant(exposure_ns) ||
      depth_size > EncodedFrame::kMaxDepthBytes || colour_size > EncodedFrame::kMaxColourBytes ||
      ((flags & 1U) == 0) != (colour_size == 0)) {
    return FrameStatus::kBadHeader;
  }
  const std::size_t size = std::size_t{depth_size} + colour_size, before = joint_bytes(joints);
  if (in.size() - kWireHeader < before + size) return FrameStatus::kTruncated;
  if (in.size() - kWireHeader > before + size) return FrameStatus::kBadHeader;
  if (check_of(in.data(), in.subspan(kWireHeader, before + size)) != check)
    return FrameStatus::kBadCheck;
  const auto blobs = in.subspan(kWireHeader + before, size);
  const auto q = get_joints(joints, in.data() + kWireHeader);
  if (!q.plausible()) return FrameStatus::kBadHeader;
  out.exposure = {static_cast<rt::Box>(box), exposure_ns};
  out.seq = seq;
  out.intrinsics = k;
  out.joints = q;
  out.has_colour = (flags & 1U) != 0;
  out.needs_previous = (flags & 2U) != 0;
  out.spared = spared_of(flags);
  out.depth_codec = static_cast<DepthCodecId>(codec);
  out.demand = 0;
  out.depth_size = depth_size;
  out.colour_size = colour_size;
  std::memcpy(out.bytes.data(), blobs.data(), blobs.size());
  return FrameStatus::kOk;
}

}  // namespace drivers
