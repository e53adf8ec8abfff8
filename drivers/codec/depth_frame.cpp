#include "drivers/codec/depth_frame.hpp"

#include "rt/hash.hpp"

namespace drivers::codec {

namespace {

constexpr std::uint32_t kMagic = 0x31534454;  // "TDS1"
constexpr std::size_t kCheckAt = 24;

template <class T>
void put(std::uint8_t*& at, T v) noexcept {
  for (std::size_t i = 0; i < sizeof(T); ++i) *at++ = static_cast<std::uint8_t>(v >> (8 * i));
}
template <class T>
T get(const std::uint8_t*& at) noexcept {
  std::uint64_t v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) v |= static_cast<std::uint64_t>(*at++) << (8 * i);
  return static_cast<T>(v);
}

}  // namespace

std::uint64_t check_of(const DepthFrameHeader& h, std::uint64_t check_before,
                       std::span<const std::uint8_t> frame) noexcept {
  rt::Hash64 hash;
  hash.bytes(frame.data(), kCheckAt);
  if (h.kind != DepthFrameKind::kKey) hash.word(check_before);
  hash.bytes(frame.data() + kDepthFrameHeader, frame.size() - kDepthFrameHeader);
  return hash.digest();
}

void write_header(DepthFrameHeader& h, std::uint64_t check_before,
                  std::span<std::uint8_t> frame) noexcept {
  std::uint8_t* at = frame.data();
  put(at, kMagic);
  put(at, static_cast<std::uint8_t>(h.kind));
  put(at, static_cast<std::uint8_t>(h.mode));
  put(at, static_cast<std::uint8_t>(h.step));
  put(at, static_cast<std::uint8_t>(h.law));
  put(at, static_cast<std::uint16_t>(h.width));
  put(at, static_cast<std::uint16_t>(h.height));
  put(at, h.seq);
  put(at, h.first_bytes);
  put(at, h.all_bytes);
  h.check = check_of(h, check_before, frame);
  put(at, h.check);
}

DepthStatus read_header(std::span<const std::uint8_t> frame, DepthFrameHeader& h) noexcept {
  if (frame.size() < kDepthFrameHeader) return DepthStatus::kTruncated;
  const std::uint8_t* at = frame.data();
  if (get<std::uint32_t>(at) != kMagic) return DepthStatus::kBadHeader;
  const auto kind = get<std::uint8_t>(at), mode = get<std::uint8_t>(at),
             step = get<std::uint8_t>(at), law = get<std::uint8_t>(at);
  if (kind > static_cast<int>(DepthFrameKind::kRefine) || mode >= kDepthModes ||
      step >= kDepthSteps || law > static_cast<int>(DepthNoiseLaw::kLenient)) {
    return DepthStatus::kBadHeader;
  }
  h.kind = static_cast<DepthFrameKind>(kind);
  h.mode = static_cast<DepthMode>(mode);
  h.step = step;
  h.law = static_cast<DepthNoiseLaw>(law);
  h.width = get<std::uint16_t>(at);
  h.height = get<std::uint16_t>(at);
  h.seq = get<std::uint32_t>(at);
  h.first_bytes = get<std::uint32_t>(at);
  h.all_bytes = get<std::uint32_t>(at);
  h.check = get<std::uint64_t>(at);
  if (h.first_bytes > h.all_bytes) return DepthStatus::kBadHeader;
  if (h.all_bytes > frame.size() - kDepthFrameHeader) return DepthStatus::kTruncated;
  if (h.all_bytes != frame.size() - kDepthFrameHeader) return DepthStatus::kBadHeader;
  return DepthStatus::kOk;
}

}  // namespace drivers::codec
