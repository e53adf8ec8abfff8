// The loops over all cells that the consensus takes many times a frame, vectors of cells at once.
// Lanes are fixed, so all instruction sets give the same bytes.
#pragma once

#include <array>

#include "perception/icp/cell_sums.hpp"

namespace perception::motion {

using PerCell = std::array<float, CellSums::kMost>;

// Mean square residual at a pose over `limit2`. `linear`: 2 xi; `square`: of the 21 of H, off the
// diagonal twice.
void misfit_of(const CellSums& sums, const float (&linear)[6], const float (&square)[21],
               const PerCell& limit2, PerCell& misfit) noexcept;

// Of the cells with at least `least` pairs and weight > 0: sums of weight times H, g, pairs.
struct WeightedSums {
  double H[21], g[6], pairs;
};
void weigh(const CellSums& sums, const PerCell& weight, float least, WeightedSums& out) noexcept;

// Of the cells with at least `least` pairs: sum of weight pairs / (1 + misfit / scale).
[[nodiscard]] double supported(const CellSums& sums, const PerCell& misfit, const PerCell& weight,
                               float scale, float least) noexcept;

}  // namespace perception::motion
