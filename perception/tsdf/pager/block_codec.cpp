#include "perception/tsdf/pager/block_codec.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "perception/geometry/no_colour.hpp"

namespace perception {
namespace {

static_assert(std::endian::native == std::endian::little, "bytes are read eight at a time");
constexpr int kVoxels = 512, kGroup = 16, kWidthBits = 5;
constexpr std::uint8_t kHasColours = 1, kHasLabels = 2;
using Residuals = std::array<std::uint32_t, kVoxels>;
using Mask = std::array<std::uint64_t, 8>;

class BitWriter {
 public:
  explicit BitWriter(std::uint8_t* out) noexcept : begin_(out), at_(out) {}
  void put(std::uint32_t value, int bits) noexcept {
    held_ |= std::uint64_t{value} << count_;
    count_ += bits;
    while (count_ >= 8) {
      *at_++ = static_cast<std::uint8_t>(held_);
      held_ >>= 8U;
      count_ -= 8;
    }
  }
  void put64(std::uint64_t value) noexcept {
    put(static_cast<std::uint32_t>(value), 32);
    put(static_cast<std::uint32_t>(value >> 32U), 32);
  }
  std::size_t finish() noexcept {
    if (count_ > 0) *at_++ = static_cast<std::uint8_t>(held_);
    return static_cast<std::size_t>(at_ - begin_);
  }

 private:
  std::uint8_t *begin_, *at_;
  std::uint64_t held_ = 0;
  int count_ = 0;
};

// Beyond the end it gives zeros and remembers.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) noexcept : bytes_(bytes) {}
  std::uint32_t get(int bits) noexcept {
    if (count_ < bits) fill(bits);
    const auto value = static_cast<std::uint32_t>(held_ & ((1ULL << bits) - 1U));
    held_ >>= bits;
    count_ -= bits;
    return value;
  }
  std::uint64_t get64() noexcept {
    const std::uint64_t low = get(32);
    return low | std::uint64_t{get(32)} << 32U;
  }
  // Everything read, nothing missing, padding zero.
  [[nodiscard]] bool complete() const noexcept {
    return !overrun_ && at_ == bytes_.size() && count_ < 8 && held_ == 0;
  }
  [[nodiscard]] bool overrun() const noexcept { return overrun_; }

 private:
  void fill(int bits) noexcept {
    if (bytes_.size() - at_ >= 8 && at_ < bytes_.size()) {
      // As many whole bytes as fit. What is loaded of the next one beyond them is loaded again, the
      // same, next time.
      std::uint64_t next = 0;
      std::memcpy(&next, bytes_.data() + at_, sizeof next);
      held_ |= next << count_;
      const int taken = (63 - count_) >> 3;
      at_ += static_cast<std::size_t>(taken);
      count_ += 8 * taken;
      return;
    }
    while (count_ < bits) {
      if (at_ < bytes_.size()) {
        held_ |= std::uint64_t{bytes_[at_]} << count_;
      } else {
        overrun_ = true;
      }
      ++at_;
      count_ += 8;
    }
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  std::uint64_t held_ = 0;
  int count_ = 0;
  bool overrun_ = false;
};

// Residual of 16 bits, modulo 2^16, small magnitudes first.
std::uint32_t fold(std::uint32_t value, std::uint32_t predicted) noexcept {
  const auto r = static_cast<std::int16_t>(static_cast<std::uint16_t>(value - predicted));
  return static_cast<std::uint16_t>(static_cast<std::uint16_t>(r) << 1U) ^
         static_cast<std::uint16_t>(r >> 15);
}
std::uint32_t unfold(std::uint32_t folded, std::uint32_t predicted) noexcept {
  const std::uint32_t r = (folded >> 1U) ^ (0U - (folded & 1U));
  return (predicted + r) & 0xffffU;
}

void put_numbers(BitWriter& w, const Residuals& v, int count) noexcept {
  for (int first = 0; first < count; first += kGroup) {
    const int n = std::min(kGroup, count - first);
    std::uint32_t any = 0;
    for (int i = 0; i < n; ++i) any |= v[static_cast<std::size_t>(first + i)];
    const int width = std::bit_width(any);
    w.put(static_cast<std::uint32_t>(width), kWidthBits);
    if (width == 0) continue;
    for (int i = 0; i < n; ++i) w.put(v[static_cast<std::size_t>(first + i)], width);
  }
}
bool get_numbers(BitReader& r, Residuals& v, int count) noexcept {
  for (int first = 0; first < count; first += kGroup) {
    const int n = std::min(kGroup, count - first);
    const auto width = static_cast<int>(r.get(kWidthBits));
    if (width > 16 || r.overrun()) return false;
    for (int i = 0; i < n; ++i)
      v[static_cast<std::size_t>(first + i)] = width == 0 ? 0U : r.get(width);
  }
  return !r.overrun();
}

Mask mask_of(std::span<const std::uint32_t, kVoxels> v) noexcept {
  Mask m{};
  for (std::size_t i = 0; i < kVoxels; ++i) m[i >> 6U] |= std::uint64_t{v[i] != 0} << (i & 63U);
  return m;
}
bool in(const Mask& m, std::size_t i) noexcept { return ((m[i >> 6U] >> (i & 63U)) & 1U) != 0; }

// What the known neighbours that came before say of the distance at voxel i: the plane through
// three of them, or one of them.
std::uint32_t predict(const std::uint16_t* d, const Mask& known, std::size_t i) noexcept {
  const std::size_t z = i & 7U, y = (i >> 3U) & 7U, x = i >> 6U;
  const bool has_z = z > 0 && in(known, i - 1), has_y = y > 0 && in(known, i - 8),
             has_x = x > 0 && in(known, i - 64);
  if (has_z && has_y && in(known, i - 9)) return std::uint32_t{d[i - 1]} + d[i - 8] - d[i - 9];
  if (has_z && has_x && in(known, i - 65)) return std::uint32_t{d[i - 1]} + d[i - 64] - d[i - 65];
  if (has_y && has_x && in(known, i - 72)) return std::uint32_t{d[i - 8]} + d[i - 64] - d[i - 72];
  return has_z ? d[i - 1] : has_y ? d[i - 8] : has_x ? d[i - 64] : 0U;
}

void put_words(BitWriter& w, std::span<const std::uint32_t, kVoxels> words) noexcept {
  const Mask known = mask_of(words);
  for (const std::uint64_t m : known) w.put64(m);
  std::array<std::uint16_t, kVoxels> d{};
  Residuals distance, weight;
  int n = 0;
  std::uint32_t last = 0;
  for (std::size_t i = 0; i < kVoxels; ++i) {
    if (words[i] == 0) continue;
    d[i] = static_cast<std::uint16_t>(words[i]);
    distance[static_cast<std::size_t>(n)] = fold(d[i], predict(d.data(), known, i));
    weight[static_cast<std::size_t>(n++)] = fold(words[i] >> 16U, last);
    last = words[i] >> 16U;
  }
  put_numbers(w, distance, n);
  put_numbers(w, weight, n);
}

bool get_words(BitReader& r, std::array<std::uint32_t, kVoxels>& words) noexcept {
  Mask known;
  int n = 0;
  for (std::uint64_t& m : known) m = r.get64(), n += std::popcount(m);
  std::array<std::uint16_t, kVoxels> d{};
  Residuals distance, weight;
  if (!get_numbers(r, distance, n) || !get_numbers(r, weight, n)) return false;
  std::uint32_t last = 0;
  std::size_t at = 0;
  for (std::size_t i = 0; i < kVoxels; ++i) {
    words[i] = 0;
    if (!in(known, i)) continue;
    d[i] = static_cast<std::uint16_t>(unfold(distance[at], predict(d.data(), known, i)));
    last = unfold(weight[at++], last);
    words[i] = d[i] | last << 16U;
    if (words[i] == 0 || d[i] == 0x8000U || last > kMostRawWeight) return false;
  }
  return true;
}

constexpr unsigned kReadingsChannel = 3, kUncolouredChannel = 4, kChannels = 5;  // after r, g, b

std::uint32_t channel_of(std::uint32_t colour, unsigned channel) noexcept {
  if (channel == kReadingsChannel) return readings_of(colour);
  if (channel == kUncolouredChannel) return readings_of(colour) - coloured_readings_of(colour);
  return (colour >> (8 * channel)) & 0xffU;
}

void put_colours(BitWriter& w, std::span<const std::uint32_t, kVoxels> colours) noexcept {
  for (const std::uint64_t m : mask_of(colours)) w.put64(m);
  for (unsigned c = 0; c < kChannels; ++c) {
    Residuals v;
    int n = 0;
    std::uint32_t last = 0;
    for (const std::uint32_t colour : colours) {
      if (colour == 0) continue;
      const std::uint32_t value = channel_of(colour, c);
      v[static_cast<std::size_t>(n++)] = fold(value, last);
      last = value;
    }
    put_numbers(w, v, n);
  }
}

bool get_colours(BitReader& r, std::array<std::uint32_t, kVoxels>& colours) noexcept {
  Mask known;
  int n = 0;
  for (std::uint64_t& m : known) m = r.get64(), n += std::popcount(m);
  colours.fill(0);
  for (unsigned c = 0; c < kChannels; ++c) {
    Residuals v;
    if (!get_numbers(r, v, n)) return false;
    std::uint32_t last = 0;
    std::size_t at = 0;
    for (std::size_t i = 0; i < kVoxels; ++i) {
      if (!in(known, i)) continue;
      last = unfold(v[at++], last);
      const std::uint32_t readings = readings_of(colours[i]);
      if (last > (c < kReadingsChannel ? 0xffU : c == kReadingsChannel ? kMostCounted : readings))
        return false;
      colours[i] |= c == kUncolouredChannel ? (readings - last) << 28U : last << (8 * c);
    }
  }
  for (std::size_t i = 0; i < kVoxels; ++i) {
    const bool coloured = coloured_readings_of(colours[i]) > 0;
    if (in(known, i) && (colours[i] == 0 || (!coloured && has_colour(colour_of(colours[i])))))
      return false;
  }
  return true;
}

void put_labels(BitWriter& w, std::span<const LabelVoxel> labels) noexcept {
  for (const auto member : {&LabelVoxel::label, &LabelVoxel::weight}) {
    Residuals v;
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < kVoxels; ++i) {
      v[i] = fold(labels[i].*member, last);
      last = labels[i].*member;
    }
    put_numbers(w, v, kVoxels);
  }
}

bool get_labels(BitReader& r, std::array<LabelVoxel, kVoxels>& labels) noexcept {
  for (const auto member : {&LabelVoxel::label, &LabelVoxel::weight}) {
    Residuals v;
    if (!get_numbers(r, v, kVoxels)) return false;
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < kVoxels; ++i) {
      last = unfold(v[i], last);
      if (last > (member == &LabelVoxel::label ? kMostLabel : kLabelWeightCap)) return false;
      labels[i].*member = static_cast<std::uint8_t>(last);
    }
  }
  return true;
}

}  // namespace

std::size_t encode_block(std::span<const std::uint32_t, 512> words,
                         std::span<const std::uint32_t, 512> colours,
                         std::span<const std::uint64_t, 8> free, std::span<const LabelVoxel> labels,
                         std::span<std::uint8_t, kMostBlockBytes> out) noexcept {
  BitWriter w(out.data());
  const bool coloured =
      std::any_of(colours.begin(), colours.end(), [](std::uint32_t c) { return c != 0; });
  const bool labelled = labels.size() == static_cast<std::size_t>(kVoxels);
  w.put((coloured ? kHasColours : 0U) | (labelled ? kHasLabels : 0U), 8);
  std::uint32_t some = 0, all = 0;
  for (std::size_t i = 0; i < free.size(); ++i) {
    some |= std::uint32_t{free[i] != 0} << i;
    all |= std::uint32_t{free[i] == ~0ULL} << i;
  }
  w.put(some, 8);
  w.put(all, 8);
  for (const std::uint64_t f : free)
    if (f != 0 && f != ~0ULL) w.put64(f);
  put_words(w, words);
  if (coloured) put_colours(w, colours);
  if (labelled) put_labels(w, labels);
  return w.finish();
}

bool decode_block(std::span<const std::uint8_t> bytes, BlockImage& out) noexcept {
  BitReader r(bytes);
  const std::uint32_t flags = r.get(8), some = r.get(8), all = r.get(8);
  if (flags > (kHasColours | kHasLabels) || (all & ~some) != 0) return false;
  for (std::size_t i = 0; i < out.free.size(); ++i) {
    out.free[i] = 0;
    if (((some >> i) & 1U) == 0) continue;
    out.free[i] = ((all >> i) & 1U) != 0 ? ~0ULL : r.get64();
  }
  if (!get_words(r, out.words)) return false;
  out.colours.fill(0);
  if ((flags & kHasColours) != 0 && !get_colours(r, out.colours)) return false;
  out.labelled = (flags & kHasLabels) != 0;
  out.labels.fill({});
  if (out.labelled && !get_labels(r, out.labels)) return false;
  return r.complete();
}

}  // namespace perception
