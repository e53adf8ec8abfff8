// Histogram of times: 64 equal buckets in each power of two, from 1 ns to 2^40 ns (18 minutes).
//
//   rank      as in rt/quantile.hpp; reported is the upper edge of the bucket that holds it
//   error     a quantile is at most 1/64 (1.6 %) above the true value, exact below 128 ns
//   record    a few instructions, no branch on history, no memory beyond the object (about 18 kB)
//   merge     adds; the order of merging does not matter
//
// Values below 0 count in the lowest bucket and values from 2^40 on in the highest; minimum,
// maximum and mean are exact all the same. One writer; copy or merge it only while the writer
// rests. Layout idea: G. Tene, HdrHistogram.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "rt/quantile.hpp"
#include "rt/time.hpp"

namespace rt {

class Histogram {
 public:
  static constexpr int kSubBits = 6;  // 64 buckets a power of two
  static constexpr int kMaxBits = 40;
  static constexpr std::int64_t kLimit = std::int64_t{1} << kMaxBits;
  static constexpr std::size_t kBuckets = static_cast<std::size_t>(kMaxBits - kSubBits + 1)
                                          << kSubBits;

  void record(std::int64_t ns) noexcept {
    ++counts_[bucket_of(ns)];
    ++count_;
    sum_ += ns;
    if (ns < min_) min_ = ns;
    if (ns > max_) max_ = ns;
  }
  void record(Nanos d) noexcept { record(d.count()); }

  void merge(const Histogram& other) noexcept {
    for (std::size_t i = 0; i < kBuckets; ++i) counts_[i] += other.counts_[i];
    count_ += other.count_;
    sum_ += other.sum_;
    if (other.min_ < min_) min_ = other.min_;
    if (other.max_ > max_) max_ = other.max_;
  }
  void reset() noexcept { *this = Histogram{}; }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }
  // Exact; 0 when empty.
  [[nodiscard]] std::int64_t min() const noexcept { return empty() ? 0 : min_; }
  [[nodiscard]] std::int64_t max() const noexcept { return empty() ? 0 : max_; }
  [[nodiscard]] double mean() const noexcept {
    return empty() ? 0.0 : static_cast<double>(sum_) / static_cast<double>(count_);
  }

  // The upper edge (within [min, max]) of the bucket that holds the quantile; 0 when empty.
  [[nodiscard]] std::int64_t quantile(double q) const noexcept {
    return at_rank(quantile_rank(q, count_));
  }
  // The same of the rank-th smallest value, rank from 1 to count(); 0 when empty.
  [[nodiscard]] std::int64_t at_rank(std::uint64_t rank) const noexcept;

  // f(lowest ns, one past the highest ns, count) for each bucket that is not empty, in order.
  template <class F>
  void for_each(F&& f) const {
    for (std::size_t i = 0; i < kBuckets; ++i) {
      if (counts_[i] > 0) f(lower_edge(i), lower_edge(i + 1), counts_[i]);
    }
  }

  // What a file keeps of it, and back: every bucket in use, then the exact ends and the sum.
  template <class F>
  void for_each_bucket(F&& f) const {
    for (std::size_t i = 0; i < kBuckets; ++i) {
      if (counts_[i] > 0) f(i, counts_[i]);
    }
  }
  struct Ends {
    std::int64_t min = 0, max = 0;
    std::uint64_t sum_low = 0;
    std::int64_t sum_high = 0;
  };
  [[nodiscard]] Ends ends() const noexcept {
    return {min(), max(), static_cast<std::uint64_t>(sum_), static_cast<std::int64_t>(sum_ >> 64)};
  }
  // False: no such bucket. `n` is above 0.
  [[nodiscard]] bool put(std::size_t bucket, std::uint64_t n) noexcept {
    if (bucket >= kBuckets || n == 0 || count_ + n < count_) return false;
    counts_[bucket] += n;
    count_ += n;
    return true;
  }
  void put(const Ends& e) noexcept {
    if (empty()) return;
    min_ = e.min;
    max_ = e.max;
    sum_ = (static_cast<Sum>(e.sum_high) << 64) | static_cast<Sum>(e.sum_low);
  }

  [[nodiscard]] static constexpr std::size_t bucket_of(std::int64_t ns) noexcept {
    const std::int64_t bounded = ns < 0 ? 0 : (ns >= kLimit ? kLimit - 1 : ns);
    const auto v = static_cast<std::uint64_t>(bounded);
    // Values below 2^kSubBits are their own bucket; above, the top kSubBits + 1 bits tell it.
    const int top = static_cast<int>(std::bit_width(v | (std::uint64_t{1} << kSubBits))) - 1;
    const int shift = top - kSubBits;
    return (static_cast<std::size_t>(shift) << kSubBits) + static_cast<std::size_t>(v >> shift);
  }
  // Smallest value of bucket i; kLimit for i == kBuckets.
  [[nodiscard]] static constexpr std::int64_t lower_edge(std::size_t i) noexcept {
    constexpr std::size_t sub = std::size_t{1} << kSubBits;
    if (i < 2 * sub) return static_cast<std::int64_t>(i);
    const std::size_t shift = (i >> kSubBits) - 1;
    return static_cast<std::int64_t>((i - (shift << kSubBits)) << shift);
  }

 private:
  __extension__ using Sum = __int128;
  std::array<std::uint64_t, kBuckets> counts_{};
  std::uint64_t count_ = 0;
  Sum sum_ = 0;
  std::int64_t min_ = std::numeric_limits<std::int64_t>::max();
  std::int64_t max_ = std::numeric_limits<std::int64_t>::min();
};

inline std::int64_t Histogram::at_rank(std::uint64_t rank) const noexcept {
  if (empty()) return 0;
  if (rank >= count_) return max_;
  std::uint64_t seen = 0;
  std::size_t i = 0;
  while ((seen += counts_[i]) < rank) ++i;
  const std::int64_t edge = lower_edge(i + 1) - 1;
  return edge > max_ ? max_ : (edge < min_ ? min_ : edge);
}

// Times of either sign: two histograms, for one knows no negative times. `below` holds the sizes of
// the negative ones.
struct SignedHistogram {
  Histogram above, below;

  void record(std::int64_t ns) noexcept { (ns >= 0 ? above : below).record(ns >= 0 ? ns : -ns); }
  void merge(const SignedHistogram& other) noexcept {
    above.merge(other.above);
    below.merge(other.below);
  }
  [[nodiscard]] std::uint64_t count() const noexcept { return above.count() + below.count(); }
  // The quantile (rt/quantile.hpp) within a bucket (1.6 %); 0 when empty.
  [[nodiscard]] std::int64_t quantile(double q) const noexcept {
    const std::uint64_t low = below.count(), rank = quantile_rank(q, count());
    // In order: first the negative ones, largest first.
    return rank <= low ? -below.at_rank(low - rank + 1) : above.at_rank(rank - low);
  }
  [[nodiscard]] std::int64_t least() const noexcept {
    return below.empty() ? above.min() : -below.max();
  }
};

}  // namespace rt
