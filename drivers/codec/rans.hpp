// Entropy coder: range asymmetric numeral systems with tables that stand in front of the data, two
// interleaved states. Source: J. Duda, "Asymmetric numeral systems" (arXiv 1311.2540); interleaving
// after F. Giesen, "Interleaved entropy coders" (arXiv 1402.3392). Own code.
//
// A context has a table of kRansSymbols frequencies that sum to 2^kRansBits. What is transmitted of
// a table are its counts to three significant bits; both sides make the frequencies from these, in
// integers.
//
// A state is in [2^15, 2^31) and gives or takes 16 bits at a time, so the encoder writes backwards:
// it is given the symbols last one first. The decoder ends where the encoder began, both states at
// 2^15: any damage that a check let through is seen there, but for one in 2^30.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/codec/bits.hpp"

namespace drivers::codec {

inline constexpr int kRansBits = 12;
inline constexpr int kRansSymbols = 32;
inline constexpr std::uint32_t kRansLow = std::uint32_t{1} << 15U;

using RansCounts = std::array<std::uint32_t, kRansSymbols>;

// A slice of the slots, and its width's inverse: ceil(2^shift / frequency), so that for any x <
// 2^31 x / frequency = x * inverse >> shift, exactly (shift = 31 + ceil(log2 frequency)).
struct RansShare {
  RansShare() = default;
  RansShare(std::uint32_t from, std::uint32_t width) noexcept
      : start(static_cast<std::uint16_t>(from)),
        frequency(static_cast<std::uint16_t>(width)),
        shift(static_cast<std::uint8_t>(31 + std::bit_width(width - 1))),
        inverse(static_cast<std::uint32_t>(((std::uint64_t{1} << shift) + width - 1) / width)) {}
  std::uint16_t start = 0, frequency = 0;
  std::uint8_t shift = 0;
  std::uint32_t inverse = 0;
};

// `start` ascends: a symbol that does not occur starts where the next one does.
struct RansTable {
  std::array<std::uint16_t, kRansSymbols> frequency{}, start{};
  // Frequencies for these counts: 0 where the count is 0, else at least 1. Counts up to 2^13.
  void build(const RansCounts& counts) noexcept;
};

// Writes the counts to three significant bits, and leaves in `counts` what the reader will get.
void write_counts(RansCounts& counts, BitWriter& out) noexcept;
// False: the counts are none that write_counts() writes.
[[nodiscard]] bool read_counts(RansCounts& counts, BitReader& in) noexcept;

// The same for a decision of two; what is kept is the frequency of 0 in [1, 2^kRansBits - 1].
[[nodiscard]] std::uint32_t write_bit_model(std::uint32_t zeros, std::uint32_t ones,
                                            BitWriter& out) noexcept;
[[nodiscard]] std::uint32_t read_bit_model(BitReader& in) noexcept;

// Backwards into the end of a span.
class RansWriter {
 public:
  explicit RansWriter(std::span<std::uint8_t> out) noexcept
      : begin_(out.data()), at_(out.data() + out.size()), end_(at_) {}
  // Without a branch on the state: whether a word is due is as good as random.
  void put(const RansShare& s) noexcept {
    if (at_ - begin_ < 2) {
      full_ = true;
      return;
    }
    std::uint32_t x = state_[0];
    at_[-2] = static_cast<std::uint8_t>(x);
    at_[-1] = static_cast<std::uint8_t>(x >> 8U);
    const unsigned due = x >= std::uint32_t{s.frequency} << (31U - kRansBits) ? 1 : 0;
    at_ -= 2 * due;
    x >>= 16 * due;
    const auto q = static_cast<std::uint32_t>((std::uint64_t{x} * s.inverse) >> s.shift);
    x += s.start + q * ((std::uint32_t{1} << static_cast<unsigned>(kRansBits)) - s.frequency);
    state_[0] = state_[1];
    state_[1] = x;
  }
  // Writes the states; the stream is the last bytes of the span.
  [[nodiscard]] std::size_t finish() noexcept {
    for (const std::uint32_t x : {state_[0], state_[1]}) {
      word(x >> 16U);
      word(x);
    }
    return static_cast<std::size_t>(end_ - at_);
  }
  [[nodiscard]] bool full() const noexcept { return full_; }

 private:
  void word(std::uint32_t x) noexcept {
    if (at_ - begin_ < 2) {
      full_ = true;
      return;
    }
    *--at_ = static_cast<std::uint8_t>(x >> 8U);
    *--at_ = static_cast<std::uint8_t>(x);
  }
  std::uint8_t *begin_, *at_, *end_;
  std::array<std::uint32_t, 2> state_{kRansLow, kRansLow};
  bool full_ = false;
};

// Which symbol a slot in [0, 2^kRansBits) belongs to.
struct RansDecodeTable {
  std::array<std::uint8_t, std::size_t{1} << static_cast<unsigned>(kRansBits)> symbol;
  RansTable table;
  void build(const RansCounts& counts) noexcept;
};

class RansReader {
 public:
  // False behind it all: the stream is shorter than its states.
  [[nodiscard]] bool begin(std::span<const std::uint8_t> in) noexcept {
    at_ = in.data();
    end_ = in.data() + in.size();
    if (in.size() < 8 || in.size() % 2 != 0) return false;
    for (std::uint32_t& x : state_) {
      x = word();
      x |= word() << 16U;
      if (x < kRansLow || x >= kRansLow << 16U) return false;
    }
    return true;
  }
  [[nodiscard]] unsigned get(const RansDecodeTable& t) noexcept {
    const std::uint32_t slot = state_[0] & kMask;
    const auto& start = t.table.start;
    if (slot < start[1]) {  // the commonest by far: no table
      step(slot, 0, start[1]);
      return 0;
    }
    const unsigned s = t.symbol[slot];
    step(slot, start[s], t.table.frequency[s]);
    return s;
  }
  [[nodiscard]] bool bit(std::uint32_t zero) noexcept {
    const std::uint32_t slot = state_[0] & kMask;
    const bool one = slot >= zero;
    step(slot, one ? zero : 0, one ? kMask + 1 - zero : zero);
    return one;
  }
  // All of it was read, and the states are where the writer began.
  [[nodiscard]] bool at_end() const noexcept {
    return at_ == end_ && !beyond_ && state_[0] == kRansLow && state_[1] == kRansLow;
  }

 private:
  static constexpr std::uint32_t kMask = (std::uint32_t{1} << kRansBits) - 1;
  void step(std::uint32_t slot, std::uint32_t start, std::uint32_t frequency) noexcept {
    std::uint32_t x = frequency * (state_[0] >> kRansBits) + slot - start;
    if (x < kRansLow) x = x << 16U | word();
    state_[0] = state_[1];
    state_[1] = x;
  }
  [[nodiscard]] std::uint32_t word() noexcept {
    if (end_ - at_ < 2) {
      beyond_ = true;
      return 0;
    }
    const std::uint32_t w = at_[0] | static_cast<std::uint32_t>(at_[1]) << 8U;
    at_ += 2;
    return w;
  }
  const std::uint8_t *at_ = nullptr, *end_ = nullptr;
  std::array<std::uint32_t, 2> state_{};
  bool beyond_ = false;
};

}  // namespace drivers::codec
