#include "drivers/codec/rans.hpp"

#include <algorithm>
#include <bit>

namespace drivers::codec {

namespace {

constexpr std::uint32_t kTotal = std::uint32_t{1} << static_cast<unsigned>(kRansBits);
constexpr unsigned kLengthBits = 4, kLastBits = 5, kModelBits = 6;

// To three significant bits, rounded down.
std::uint32_t rounded(std::uint32_t v) noexcept {
  const auto length = static_cast<unsigned>(std::bit_width(v));
  return length <= 3 ? v : v >> (length - 3) << (length - 3);
}

// A share of zeros on a scale that is fine near both ends: 0 .. 63.
constexpr std::uint32_t model_zero(std::uint32_t code) noexcept {
  const std::uint32_t half = code < 32 ? code : 63 - code;
  // 2^-11 at code 0, doubling every three codes up to one half.
  constexpr std::array<std::uint32_t, 3> kThirds{32, 40, 51};
  const std::uint32_t few = std::min(2048U, (kThirds[half % 3] << (half / 3)) / 16);
  return code < 32 ? few : kTotal - few;
}

}  // namespace

void RansTable::build(const RansCounts& counts) noexcept {
  std::uint64_t sum = 0;
  std::size_t most = 0;
  for (std::size_t s = 0; s < counts.size(); ++s) {
    sum += counts[s];
    if (counts[s] > counts[most]) most = s;
  }
  frequency = {};
  if (sum == 0) {
    frequency[0] = kTotal;
    start.fill(kTotal);
    start[0] = 0;
    return;
  }
  std::uint32_t given = 0;
  for (std::size_t s = 0; s < counts.size(); ++s) {
    if (counts[s] == 0) continue;
    const auto part = static_cast<std::uint32_t>((std::uint64_t{counts[s]} * kTotal) / sum);
    frequency[s] = static_cast<std::uint16_t>(std::max(1U, part));
    given += frequency[s];
  }
  // The commonest symbol takes what rounding left over or took too much: it has at least kTotal /
  // kRansSymbols - 1, and rounding up took at most one for each of the others.
  frequency[most] = static_cast<std::uint16_t>(frequency[most] + kTotal - given);
  std::uint32_t at = 0;
  for (std::size_t s = 0; s < counts.size(); ++s) {
    start[s] = static_cast<std::uint16_t>(at);
    at += frequency[s];
  }
}

void RansDecodeTable::build(const RansCounts& counts) noexcept {
  table.build(counts);
  for (std::size_t s = 0; s < counts.size(); ++s) {
    std::fill_n(symbol.begin() + table.start[s], table.frequency[s], static_cast<std::uint8_t>(s));
  }
}

void write_counts(RansCounts& counts, BitWriter& out) noexcept {
  std::uint32_t most = 0;
  for (const std::uint32_t c : counts) most = std::max(most, c);
  // Shares of 8191 at most: lengths of 0 .. 13 bits.
  const auto width = static_cast<unsigned>(std::bit_width(most));
  const unsigned shift = width > 13 ? width - 13 : 0;
  unsigned last = 0;
  for (unsigned s = 0; s < counts.size(); ++s) {
    if (counts[s] == 0) continue;
    counts[s] = rounded(std::max(1U, counts[s] >> shift));
    last = s;
  }
  out.put(last, kLastBits);
  for (unsigned s = 0; s <= last; ++s) {
    const auto length = static_cast<unsigned>(std::bit_width(counts[s]));
    out.put(length, kLengthBits);
    if (length == 2) out.put(counts[s] & 1U, 1);
    if (length >= 3) out.put((counts[s] >> (length - 3)) & 3U, 2);
  }
}

bool read_counts(RansCounts& counts, BitReader& in) noexcept {
  counts = {};
  const unsigned last = in.get(kLastBits);
  for (unsigned s = 0; s <= last; ++s) {
    const unsigned length = in.get(kLengthBits);
    if (length > 13) return false;
    if (length == 1) counts[s] = 1;
    if (length == 2) counts[s] = 2 + in.get(1);
    if (length >= 3) counts[s] = (4 + in.get(2)) << (length - 3);
  }
  return true;
}

std::uint32_t write_bit_model(std::uint32_t zeros, std::uint32_t ones, BitWriter& out) noexcept {
  const std::uint64_t sum = std::uint64_t{zeros} + ones;
  const auto share = static_cast<std::uint32_t>(sum == 0 ? kTotal / 2 : zeros * kTotal / sum);
  std::uint32_t best = 0, best_off = kTotal;
  for (std::uint32_t code = 0; code < 64; ++code) {
    const std::uint32_t z = model_zero(code), off = z > share ? z - share : share - z;
    if (off < best_off) best = code, best_off = off;
  }
  out.put(best, kModelBits);
  return model_zero(best);
}

std::uint32_t read_bit_model(BitReader& in) noexcept { return model_zero(in.get(kModelBits)); }

}  // namespace drivers::codec
