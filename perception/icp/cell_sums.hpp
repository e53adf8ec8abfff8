// The sums of ICP, one set for each cell of the image. A cell is 8 x 8 pixels of a level.
//
// Sums are additive. So the best pose for any set of cells is one 6x6 solve, and the residual of
// any pose near the one at which they were taken follows without reading a pixel again:
//     sum r^2 (xi) = r2 + 2 g . xi + xi' H xi.
// All pixels have the same weight, so near things count only by their number of pixels
// (perception/motion/consensus.hpp).
#pragma once

#include <array>

#include "perception/icp/normal_equations.hpp"

namespace perception {

// Structure of arrays: one entry a cell, row-major. fp32; the same bytes on every instruction set.
struct CellSums {
  static constexpr int kEdge = 8;  // pixels
  static constexpr int kMostColumns = 20, kMostRows = 16;
  static constexpr int kMost = kMostColumns * kMostRows;
  template <int kCount>
  using Table = std::array<std::array<float, kMost>, kCount>;

  int columns = 0, rows = 0;
  Table<21> H{};  // upper triangle by rows
  Table<6> g{};
  std::array<float, kMost> r2{};       // m^2
  std::array<float, kMost> pairs{};    // pixels within the gates
  std::array<float, kMost> live{};     // pixels with depth
  std::array<float, kMost> depth_m{};  // mean of those; 0: none

  [[nodiscard]] int size() const noexcept { return columns * rows; }
};

// Does an image of this size fit?
[[nodiscard]] constexpr bool fits_cells(int width, int height) noexcept {
  return width <= CellSums::kMostColumns * CellSums::kEdge &&
         height <= CellSums::kMostRows * CellSums::kEdge;
}

// The sums of a level that fits_cells(). Twists are about `centre_F`, as in accumulate(). Only the
// upper `rows` rows of each cell are read; they stand for the others. Without `recount` the number
// of pixels with depth and their mean depth stay as they are (same image). Noexcept, no allocation.
void accumulate_cells(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                      const Vec3& centre_F, const Gates& gates, CellSums& out,
                      int rows = CellSums::kEdge, bool recount = true) noexcept;

}  // namespace perception
