// How long the calls into a device take: the tick's part that may block, with a bound of its own.
// Written by the device's owner; read by anyone (single words, so a reader may see a count early).
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstdint>

#include "rt/quantile.hpp"

namespace drivers {

class ExchangeHistogram {
 public:
  explicit ExchangeHistogram(std::int64_t bound_ns) : bound_ns_(bound_ns) {}

  void add(std::int64_t ns) noexcept {
    const auto v = static_cast<std::uint64_t>(ns < 0 ? 0 : ns);
    bump(bins_[bin_of(v)]);
    if (ns > max_ns_.load(std::memory_order_relaxed)) {
      max_ns_.store(ns, std::memory_order_relaxed);
    }
    if (ns > bound_ns_) bump(over_);
  }

  [[nodiscard]] std::uint64_t count() const noexcept {
    std::uint64_t n = 0;
    for (const auto& b : bins_) n += b.load(std::memory_order_relaxed);
    return n;
  }
  // Upper edge of the bin that holds the quantile's rank (rt/quantile.hpp); a bin is at most a
  // quarter of its value wide. 0 when empty.
  [[nodiscard]] std::int64_t quantile_ns(double q) const noexcept {
    const std::uint64_t n = count();
    if (n == 0) return 0;
    const std::uint64_t rank = rt::quantile_rank(q, n);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < bins_.size(); ++i) {
      seen += bins_[i].load(std::memory_order_relaxed);
      if (seen >= rank) return upper_edge(i);
    }
    return max_ns();
  }
  [[nodiscard]] std::int64_t max_ns() const noexcept {
    return max_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::int64_t bound_ns() const noexcept { return bound_ns_; }
  [[nodiscard]] std::uint64_t over_bound() const noexcept {
    return over_.load(std::memory_order_relaxed);
  }

 private:
  // Four bins an octave: 0..3 ns are bins 0..3, then 2^k .. 2^(k+1) in four equal parts.
  [[nodiscard]] static std::size_t bin_of(std::uint64_t v) noexcept {
    if (v < 4) return static_cast<std::size_t>(v);
    const auto octave = static_cast<int>(std::bit_width(v)) - 1;
    const auto part = static_cast<std::size_t>((v >> (octave - 2)) & 3U);
    const std::size_t i = static_cast<std::size_t>(octave - 1) * 4 + part;
    return i < kBins ? i : kBins - 1;
  }
  [[nodiscard]] static std::int64_t upper_edge(std::size_t i) noexcept {
    if (i < 4) return static_cast<std::int64_t>(i);
    const auto octave = static_cast<int>(i / 4) + 1;
    return ((std::int64_t{5} + static_cast<std::int64_t>(i % 4)) << (octave - 2)) - 1;
  }
  // One writer: a load and a store, no locked instruction.
  static void bump(std::atomic<std::uint64_t>& word) noexcept {
    word.store(word.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }

  static constexpr std::size_t kBins = 140;  // up to 34 s
  std::int64_t bound_ns_;
  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<std::int64_t> max_ns_{0};
  std::atomic<std::uint64_t> over_{0};
};

}  // namespace drivers
