#include "drivers/link/depth_codec.hpp"

#include <cstring>

namespace drivers {

namespace {

constexpr std::uint8_t kCoded = 1, kPlain = 2;
constexpr unsigned kGroupBits = 3;  // of a nibble; the fourth says that more follow
constexpr std::uint32_t kMore = 8;

// Nibbles, low one first, eight bytes at a time.
class NibbleWriter {
 public:
  NibbleWriter(std::uint8_t* out, std::uint8_t* end) noexcept : at_(out), end_(end) {}
  void number(std::uint32_t v) noexcept {
    while (v >= kMore) {
      nibble((v & (kMore - 1)) | kMore);
      v >>= kGroupBits;
    }
    nibble(v);
  }
  // End of the data, nullptr when it did not fit.
  [[nodiscard]] std::uint8_t* finish() noexcept {
    const std::size_t left = (filled_ + 7) / 8;
    if (full_ || left > static_cast<std::size_t>(end_ - at_)) return nullptr;
    for (std::size_t i = 0; i < left; ++i) *at_++ = static_cast<std::uint8_t>(word_ >> (8 * i));
    return at_;
  }
  [[nodiscard]] bool full() const noexcept { return full_; }

 private:
  void nibble(std::uint64_t n) noexcept {
    word_ |= n << filled_;
    filled_ += 4;
    if (filled_ < 64) return;
    if (end_ - at_ < 8) {
      full_ = true;
    } else {
      for (unsigned i = 0; i < 8; ++i) at_[i] = static_cast<std::uint8_t>(word_ >> (8 * i));
      at_ += 8;
    }
    word_ = 0;
    filled_ = 0;
  }
  std::uint8_t *at_, *end_;
  std::uint64_t word_ = 0;
  unsigned filled_ = 0;  // bits
  bool full_ = false;
};

class NibbleReader {
 public:
  NibbleReader(const std::uint8_t* in, const std::uint8_t* end) noexcept : at_(in), end_(end) {}
  // False at the end of the data and for a number of more than 32 bits.
  [[nodiscard]] bool number(std::uint32_t& v) noexcept {
    v = 0;
    for (unsigned shift = 0; shift < 32; shift += kGroupBits) {
      if (have_ == 0 && !fetch()) return false;
      const auto n = static_cast<std::uint32_t>(word_ & 15U);
      word_ >>= 4U;
      have_ -= 4;
      v |= (n & (kMore - 1)) << shift;
      if (n < kMore) return true;
    }
    return false;
  }
  // Nothing but the zero padding of the last byte is left.
  [[nodiscard]] bool at_end() const noexcept { return at_ == end_ && have_ <= 4 && word_ == 0; }

 private:
  [[nodiscard]] bool fetch() noexcept {
    const std::ptrdiff_t left = end_ - at_;
    if (left <= 0) return false;
    const unsigned n = left < 8 ? static_cast<unsigned>(left) : 8U;
    word_ = 0;
    for (unsigned i = 0; i < n; ++i) word_ |= static_cast<std::uint64_t>(at_[i]) << (8 * i);
    at_ += n;
    have_ = 8 * n;
    return true;
  }
  const std::uint8_t *at_, *end_;
  std::uint64_t word_ = 0;
  unsigned have_ = 0;  // bits
};

// Small differences of either sign become small numbers: 0, -1, 1, -2, 2 ...
std::uint32_t fold(std::int32_t d) noexcept {
  return (static_cast<std::uint32_t>(d) << 1U) ^ static_cast<std::uint32_t>(d >> 31);
}
std::int32_t unfold(std::uint32_t v) noexcept {
  return static_cast<std::int32_t>(v >> 1U) ^ -static_cast<std::int32_t>(v & 1U);
}

std::size_t encode_plain(std::span<const std::uint16_t> depth, std::uint8_t* out) noexcept {
  out[0] = kPlain;
  for (std::size_t i = 0; i < depth.size(); ++i) {
    out[1 + 2 * i] = static_cast<std::uint8_t>(depth[i]);
    out[2 + 2 * i] = static_cast<std::uint8_t>(depth[i] >> 8U);
  }
  return 1 + 2 * depth.size();
}

}  // namespace

std::size_t encode_depth(std::span<const std::uint16_t> depth,
                         std::span<std::uint8_t> out) noexcept {
  if (out.size() < max_depth_bytes(depth.size())) return 0;
  out[0] = kCoded;
  NibbleWriter w(out.data() + 1, out.data() + 1 + 2 * depth.size());
  const std::uint16_t *at = depth.data(), *const end = at + depth.size();
  std::int32_t previous = 0;
  while (at != end && !w.full()) {
    const std::uint16_t* run = at;
    while (at != end && *at == 0) ++at;
    w.number(static_cast<std::uint32_t>(at - run));
    run = at;
    while (at != end && *at != 0) ++at;
    w.number(static_cast<std::uint32_t>(at - run));
    for (; run != at; ++run) {
      w.number(fold(*run - previous));
      previous = *run;
    }
  }
  const std::uint8_t* stop = w.finish();
  if (stop == nullptr) return encode_plain(depth, out.data());
  return static_cast<std::size_t>(stop - out.data());
}

bool decode_depth(std::span<const std::uint8_t> in, std::span<std::uint16_t> depth) noexcept {
  if (in.empty()) return false;
  if (in[0] == kPlain) {
    if (in.size() != 1 + 2 * depth.size()) return false;
    for (std::size_t i = 0; i < depth.size(); ++i) {
      depth[i] = static_cast<std::uint16_t>(in[1 + 2 * i] | in[2 + 2 * i] << 8U);
    }
    return true;
  }
  if (in[0] != kCoded) return false;
  NibbleReader r(in.data() + 1, in.data() + in.size());
  std::uint16_t *at = depth.data(), *const end = at + depth.size();
  std::int32_t previous = 0;
  while (at != end) {
    std::uint32_t run = 0;
    if (!r.number(run) || run > static_cast<std::size_t>(end - at)) return false;
    std::memset(at, 0, run * sizeof *at);
    at += run;
    if (!r.number(run) || run > static_cast<std::size_t>(end - at)) return false;
    // Only the last chain may be without readings; else a loop of empty chains could go on for as
    // long as there is data.
    if (run == 0 && at != end) return false;
    for (const std::uint16_t* stop = at + run; at != stop; ++at) {
      std::uint32_t v = 0;
      if (!r.number(v) || v > 2U * 65535U + 1U) return false;
      previous += unfold(v);
      if (previous < 1 || previous > 65535) return false;
      *at = static_cast<std::uint16_t>(previous);
    }
  }
  return r.at_end();
}

}  // namespace drivers
