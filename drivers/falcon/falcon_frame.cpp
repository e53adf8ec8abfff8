#include "drivers/falcon/falcon_frame.hpp"

namespace drivers {
namespace {

constexpr std::uint8_t kBegin = '<', kEnd = '>', kZero = 'A';
constexpr std::uint8_t kLargest = kZero + 0x7F;

void put_word(FalconFrame& f, std::size_t at, std::int16_t value) noexcept {
  const auto bits = static_cast<std::uint16_t>(value);
  for (std::size_t i = 0; i < 4; ++i) {
    f[at + i] = static_cast<std::uint8_t>(kZero + ((bits >> (4 * i)) & 0xFU));
  }
}

bool get_word(const FalconFrame& f, std::size_t at, std::int16_t& value) noexcept {
  unsigned bits = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const unsigned nibble = static_cast<unsigned>(f[at + i]) - kZero;  // below 'A' wraps to large
    if (nibble > 0xF) return false;
    bits |= nibble << (4 * i);
  }
  value = static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
  return true;
}

FalconFrame frame_of(const std::array<std::int16_t, 3>& words, unsigned flags,
                     unsigned last) noexcept {
  FalconFrame f{};
  f.front() = kBegin;
  f.back() = kEnd;
  for (std::size_t i = 0; i < 3; ++i) put_word(f, 1 + 4 * i, words[i]);
  f[13] = static_cast<std::uint8_t>(kZero + (flags & 0x7FU));
  f[14] = static_cast<std::uint8_t>(kZero + (last & 0x7FU));
  return f;
}

bool parts_of(const FalconFrame& f, std::array<std::int16_t, 3>& words, unsigned& flags,
              unsigned& last) noexcept {
  if (f.front() != kBegin || f.back() != kEnd) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!get_word(f, 1 + 4 * i, words[i])) return false;
  }
  flags = static_cast<unsigned>(f[13]) - kZero;
  last = static_cast<unsigned>(f[14]) - kZero;
  return flags <= 0x7F && last <= 0x7F;
}

}  // namespace

FalconFrame encode(const FalconCommand& c) noexcept {
  return frame_of(c.torque_cnt,
                  (c.home ? 1U : 0U) | (c.green ? 2U : 0U) | (c.blue ? 4U : 0U) | (c.red ? 8U : 0U),
                  0);
}

FalconFrame encode(const FalconReport& r) noexcept {
  return frame_of(r.encoder_cnt, (r.buttons & 0xFU) | ((r.homed & 7U) << 4), r.unknown);
}

bool decode(const FalconFrame& f, FalconCommand& out) noexcept {
  FalconCommand c;
  unsigned flags = 0, last = 0;
  if (!parts_of(f, c.torque_cnt, flags, last)) return false;
  c.home = (flags & 1U) != 0;
  c.green = (flags & 2U) != 0;
  c.blue = (flags & 4U) != 0;
  c.red = (flags & 8U) != 0;
  out = c;
  return true;
}

bool decode(const FalconFrame& f, FalconReport& out) noexcept {
  FalconReport r;
  unsigned flags = 0, last = 0;
  if (!parts_of(f, r.encoder_cnt, flags, last)) return false;
  r.buttons = static_cast<std::uint8_t>(flags & 0xFU);
  r.homed = static_cast<std::uint8_t>(flags >> 4);
  r.unknown = static_cast<std::uint8_t>(last);
  out = r;
  return true;
}

bool FalconFramer::push(std::uint8_t byte) noexcept {
  if (byte == kBegin) {
    if (size_ > 0) ++damaged_;
    frame_[0] = byte;
    size_ = 1;
    return false;
  }
  if (size_ == 0) {
    ++stray_;
    return false;
  }
  const bool last = size_ == kFalconFrameSize - 1;
  const bool fits = last ? byte == kEnd : byte >= kZero && byte <= kLargest;
  if (!fits) {
    ++damaged_;
    size_ = 0;
    return false;
  }
  frame_[size_++] = byte;
  if (!last) return false;
  size_ = 0;
  return true;
}

}  // namespace drivers
