#include "drivers/codec/depth_stream.hpp"

#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/codec/depth_frame.hpp"
#include "rt/hash.hpp"

namespace drivers {

using codec::DepthFrameHeader;

namespace {

std::size_t checked_pixels(const DepthStreamConfig& c) {
  if (c.width < 1 || c.width > 640 || c.height < 1 || c.height > 480) {
    throw std::invalid_argument("depth stream: size " + std::to_string(c.width) + " x " +
                                std::to_string(c.height) + ", allowed 1 x 1 to 640 x 480");
  }
  return static_cast<std::size_t>(c.width) * static_cast<std::size_t>(c.height);
}

std::uint64_t hash_of(const std::vector<std::uint16_t>& image) noexcept {
  rt::Hash64 h;
  h.bytes(image.data(), image.size() * sizeof image[0]);
  return h.digest();
}

DepthFrameInfo info_of(const DepthFrameHeader& h) noexcept {
  DepthFrameInfo i;
  i.kind = h.kind;
  i.mode = h.mode;
  i.step = h.step;
  i.seq = h.seq;
  i.bytes = static_cast<std::uint32_t>(kDepthFrameHeader) + h.all_bytes;
  i.blocks = static_cast<std::uint32_t>((h.width + 7) / 8 * ((h.height + 7) / 8));
  return i;
}

}  // namespace

struct DepthEncoder::State {
  State(const DepthStreamConfig& c) : config(c), image(checked_pixels(c)) {}
  DepthStreamConfig config;
  std::vector<std::uint16_t> image;  // what the decoder holds
  std::uint32_t seq = 0;
  std::uint64_t check = 0;  // of the last frame
};

DepthEncoder::DepthEncoder(rt::NonRealtime&, const DepthStreamConfig& c)
    : state_(std::make_unique<State>(c)) {}
DepthEncoder::~DepthEncoder() = default;
DepthEncoder::DepthEncoder(DepthEncoder&&) noexcept = default;
DepthEncoder& DepthEncoder::operator=(DepthEncoder&&) noexcept = default;
void DepthEncoder::restart() noexcept {}
std::uint64_t DepthEncoder::state_hash() const noexcept { return hash_of(state_->image); }

DepthStatus DepthEncoder::encode(std::span<const std::uint16_t> depth_mm, const DepthDemand& demand,
                                 std::span<std::uint8_t> out, DepthFrameInfo& info,
                                 rt::ForkJoin&) noexcept {
  State& s = *state_;
  if (depth_mm.size() != s.image.size() || out.size() < max_depth_frame_bytes(s.image.size())) {
    return DepthStatus::kNoRoom;
  }
  DepthFrameHeader h;
  h.mode = demand.mode;
  h.step =
      demand.step >= 0 && demand.step < kDepthSteps ? demand.step : default_depth_step(demand.mode);
  h.law = s.config.law;
  h.width = s.config.width;
  h.height = s.config.height;
  h.seq = s.seq++;
  h.first_bytes = h.all_bytes = static_cast<std::uint32_t>(2 * s.image.size());
  for (std::size_t i = 0; i < depth_mm.size(); ++i) {
    s.image[i] = depth_mm[i];
    out[kDepthFrameHeader + 2 * i] = static_cast<std::uint8_t>(depth_mm[i]);
    out[kDepthFrameHeader + 2 * i + 1] = static_cast<std::uint8_t>(depth_mm[i] >> 8U);
  }
  codec::write_header(h, s.check, out.first(kDepthFrameHeader + h.all_bytes));
  s.check = h.check;
  info = info_of(h);
  info.coded_blocks = info.blocks;
  return DepthStatus::kOk;
}

struct DepthDecoder::State {
  State(const DepthStreamConfig& c) : config(c), image(checked_pixels(c)) {}
  DepthStreamConfig config;
  std::vector<std::uint16_t> image;
  bool has_image = false;
  std::uint32_t seq = 0;    // of the last frame
  std::uint64_t check = 0;  // of the last frame
};

DepthDecoder::DepthDecoder(rt::NonRealtime&, const DepthStreamConfig& c)
    : state_(std::make_unique<State>(c)) {}
DepthDecoder::~DepthDecoder() = default;
DepthDecoder::DepthDecoder(DepthDecoder&&) noexcept = default;
DepthDecoder& DepthDecoder::operator=(DepthDecoder&&) noexcept = default;
bool DepthDecoder::needs_key() const noexcept { return !state_->has_image; }
std::uint64_t DepthDecoder::state_hash() const noexcept { return hash_of(state_->image); }

DepthStatus DepthDecoder::decode(std::span<const std::uint8_t> frame,
                                 std::span<std::uint16_t> depth_mm, DepthFrameInfo& info,
                                 rt::ForkJoin&) noexcept {
  State& s = *state_;
  if (depth_mm.size() != s.image.size()) return DepthStatus::kNoRoom;
  DepthFrameHeader h;
  if (const DepthStatus bad = codec::read_header(frame, h); bad != DepthStatus::kOk) return bad;
  if (h.width != s.config.width || h.height != s.config.height) return DepthStatus::kBadSize;
  if (h.kind != DepthFrameKind::kKey && (!s.has_image || h.seq != s.seq + 1)) {
    return DepthStatus::kNeedsKey;
  }
  if (codec::check_of(h, s.check, frame) != h.check) return DepthStatus::kBadCheck;
  if (h.all_bytes != 2 * s.image.size()) {
    s.has_image = false;
    return DepthStatus::kBadData;
  }
  const std::uint8_t* at = frame.data() + kDepthFrameHeader;
  for (std::size_t i = 0; i < s.image.size(); ++i) {
    s.image[i] = static_cast<std::uint16_t>(at[2 * i] | at[2 * i + 1] << 8U);
    depth_mm[i] = s.image[i];
  }
  s.has_image = true;
  s.seq = h.seq;
  s.check = h.check;
  info = info_of(h);
  return DepthStatus::kOk;
}

}  // namespace drivers
