// From a chunk's coordinates to a number: open addressing with linear probing, at most half full.
// An entry is erased by moving back what follows it (Knuth, TAOCP 6.4, algorithm R), so that probes
// stay short however often chunks come and go.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace perception {

class ChunkIndex {
 public:
  static constexpr std::int32_t kNone = -1;

  // Room for `capacity` entries; the caller never inserts more.
  ChunkIndex(rt::NonRealtime&, std::size_t capacity)
      : keys_(std::bit_ceil(2 * std::max<std::size_t>(capacity, 1))), values_(keys_.size()) {}

  // Coordinates take 21 bits each.
  [[nodiscard]] std::int32_t find(int x, int y, int z) const noexcept {
    const std::uint64_t key = key_of(x, y, z);
    for (std::size_t s = home(key); keys_[s] != 0; s = next(s))
      if (keys_[s] == key) return values_[s];
    return kNone;
  }
  // Of coordinates that are not there yet.
  void insert(int x, int y, int z, std::int32_t value) noexcept {
    const std::uint64_t key = key_of(x, y, z);
    std::size_t s = home(key);
    while (keys_[s] != 0) s = next(s);
    keys_[s] = key;
    values_[s] = value;
  }
  void erase(int x, int y, int z) noexcept {
    const std::uint64_t key = key_of(x, y, z);
    std::size_t hole = home(key);
    while (keys_[hole] != key) {
      if (keys_[hole] == 0) return;
      hole = next(hole);
    }
    for (std::size_t s = next(hole); keys_[s] != 0; s = next(s)) {
      // What lies between its home and here without a gap may fill the hole.
      const std::size_t mask = keys_.size() - 1;
      if (((s - home(keys_[s])) & mask) < ((s - hole) & mask)) continue;
      keys_[hole] = keys_[s];
      values_[hole] = values_[s];
      hole = s;
    }
    keys_[hole] = 0;
  }
  void clear() noexcept { std::fill(keys_.begin(), keys_.end(), std::uint64_t{0}); }
  [[nodiscard]] std::size_t memory_bytes() const noexcept {
    return keys_.size() * (sizeof keys_[0] + sizeof values_[0]);
  }

 private:
  static std::uint64_t key_of(int x, int y, int z) noexcept {
    constexpr std::uint64_t kMask = (1U << 21U) - 1U;
    return (1ULL << 63U) | ((static_cast<std::uint64_t>(x) & kMask) << 42U) |
           ((static_cast<std::uint64_t>(y) & kMask) << 21U) |
           (static_cast<std::uint64_t>(z) & kMask);
  }
  [[nodiscard]] std::size_t home(std::uint64_t key) const noexcept {
    return rt::mix64(key) & (keys_.size() - 1);
  }
  [[nodiscard]] std::size_t next(std::size_t s) const noexcept {
    return (s + 1) & (keys_.size() - 1);
  }
  std::vector<std::uint64_t> keys_;  // 0 = empty
  std::vector<std::int32_t> values_;
};

}  // namespace perception
