#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "perception/segmentation/surface_patches.hpp"

namespace perception {

// Pixels of a surface by their colour a, b: which share of it is like a piece.
class ColourShares {
 public:
  void add(const SurfacePiece& p) noexcept {
    const auto n = static_cast<float>(p.coloured);
    counts_[index(cell(p.a), cell(p.b))] += n;
    all_ += n;
  }
  // Of the pixels, those of cells whose middle is within `reach` of the piece's colour.
  [[nodiscard]] float like(const SurfacePiece& p, float reach) const noexcept {
    const auto first = [&](float x) { return cell(x - reach); };
    const auto last = [&](float x) { return cell(x + reach); };
    float n = 0;
    for (int i = first(p.a); i <= last(p.a); ++i)
      for (int j = first(p.b); j <= last(p.b); ++j)
        if (std::hypot(middle(i) - p.a, middle(j) - p.b) <= reach) n += counts_[index(i, j)];
    return n / all_;
  }

 private:
  static constexpr int kCells = 64;
  static constexpr float kWidth = 4, kLeast = -128;  // Lab units
  static int cell(float x) noexcept {
    return std::clamp(static_cast<int>((x - kLeast) / kWidth), 0, kCells - 1);
  }
  static float middle(int k) noexcept { return kLeast + kWidth * (static_cast<float>(k) + 0.5F); }
  static std::size_t index(int i, int j) noexcept {
    return static_cast<std::size_t>(i * kCells + j);
  }
  std::array<float, std::size_t{kCells} * kCells> counts_{};
  float all_ = 0;
};

}  // namespace perception
