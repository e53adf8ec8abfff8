// Shortest grid distances from a set of cells, with 8 neighbours and no cutting of corners: Dial's
// bucket queue on integer lengths (5 straight, 7 diagonal). What it reaches is exactly what a point
// can reach over cells of at most `limit` (diagonal steps need both side cells, so 4-connectivity
// decides).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "perception/ground/cost_map.hpp"
#include "rt/clock/tick.hpp"

namespace tasks {

class Flood {
 public:
  static constexpr std::int32_t kFar = INT32_MAX;
  static constexpr int kStraight = 5, kDiagonal = 7;

  struct Seed {
    std::int32_t cell = 0;
    std::int32_t length = 0;  // in steps of 1/5 cell; clipped to what the queue can hold
  };
  // False: cancelled, or no seed is passable.
  bool run(const perception::CostMap& map, std::span<const Seed> seeds, std::uint8_t limit,
           const rt::Tick& tick) noexcept;

  [[nodiscard]] bool reached(std::int32_t cell) const noexcept {
    return length_[static_cast<std::size_t>(cell)] != kFar;
  }
  [[nodiscard]] std::int32_t length(std::int32_t cell) const noexcept {
    return length_[static_cast<std::size_t>(cell)];
  }
  // The cell before this one on a shortest way; the cell itself for a seed.
  [[nodiscard]] std::int32_t parent(std::int32_t cell) const noexcept {
    return parent_[static_cast<std::size_t>(cell)];
  }
  // Reached cells, nearest first.
  [[nodiscard]] std::span<const std::int32_t> cells() const noexcept {
    return {cells_.data(), static_cast<std::size_t>(count_)};
  }
  [[nodiscard]] std::uint8_t limit() const noexcept { return limit_; }

 private:
  static constexpr std::size_t kCells =
      static_cast<std::size_t>(perception::CostMap::kMaxCells) * perception::CostMap::kMaxCells;
  static constexpr std::int32_t kBuckets = 1024;
  static constexpr std::int32_t kNone = -1;

  void relax(std::int32_t cell, std::int32_t length, std::int32_t parent) noexcept;
  void unlink(std::int32_t cell) noexcept;

  std::array<std::int32_t, kCells> length_{}, parent_{}, next_{}, before_{}, cells_{};
  std::array<std::int32_t, kBuckets> head_{};
  std::int32_t count_ = 0, queued_ = 0;
  std::uint8_t limit_ = 0;
};

}  // namespace tasks
