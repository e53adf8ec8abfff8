// Bits, low one first, into and out of a span of bytes: what is not worth an entropy coder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace drivers::codec {

class BitWriter {
 public:
  explicit BitWriter(std::span<std::uint8_t> out) noexcept
      : begin_(out.data()), at_(out.data()), end_(out.data() + out.size()) {}
  // count in [0, 32]; bits of `value` above them are zero.
  void put(std::uint32_t value, unsigned count) noexcept {
    word_ |= std::uint64_t{value} << filled_;
    filled_ += count;
    while (filled_ >= 8) flush_byte();
  }
  // Bytes in all, the last one filled up with zeros; nothing may be put afterwards.
  [[nodiscard]] std::size_t finish() noexcept {
    if (filled_ > 0) {
      filled_ = 8;
      flush_byte();
    }
    return static_cast<std::size_t>(at_ - begin_);
  }
  // More was put than there is room for: what is there is of no use.
  [[nodiscard]] bool full() const noexcept { return full_; }

 private:
  void flush_byte() noexcept {
    if (at_ == end_) {
      full_ = true;
    } else {
      *at_++ = static_cast<std::uint8_t>(word_);
    }
    word_ >>= 8U;
    filled_ -= 8;
  }
  std::uint8_t *begin_, *at_, *end_;
  std::uint64_t word_ = 0;
  unsigned filled_ = 0;
  bool full_ = false;
};

// Behind the end there are zeros; at_end() tells.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> in) noexcept
      : at_(in.data()), end_(in.data() + in.size()) {}
  // count in [0, 32].
  [[nodiscard]] std::uint32_t get(unsigned count) noexcept {
    while (have_ < count) {
      if (at_ != end_) {
        word_ |= std::uint64_t{*at_++} << have_;
      } else {
        beyond_ = true;
      }
      have_ += 8;
    }
    const auto v = static_cast<std::uint32_t>(word_ & ((std::uint64_t{1} << count) - 1));
    word_ >>= count;
    have_ -= count;
    return v;
  }
  // All was read but the zeros that fill the last byte, and nothing beyond.
  [[nodiscard]] bool at_end() const noexcept {
    return at_ == end_ && have_ < 8 && word_ == 0 && !beyond_;
  }

 private:
  const std::uint8_t *at_, *end_;
  std::uint64_t word_ = 0;
  unsigned have_ = 0;
  bool beyond_ = false;
};

}  // namespace drivers::codec
