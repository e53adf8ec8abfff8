// CostMap: what the robot's body may drive over, on the ground plane.
//
// Grid frame M: origin at a corner of cell (0,0), x and y along the grid on the fitted ground
// plane, z up (against gravity). Cell (ix, iy) covers [ix, ix+1) x [iy, iy+1) times resolution.
// X_WM places the grid in the world.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace perception {

struct CostMap {
  static constexpr int kMaxCells = 256;  // along an edge
  enum Cell : std::uint8_t {
    kFree = 0,         // 1..252: inflation, larger is nearer to an obstacle
    kInscribed = 253,  // the robot's centre here would touch an obstacle
    kOccupied = 254,   // an obstacle in the robot's height band, or a virtual one
    kUnknown = 255,    // never seen: not driveable for planning, not an obstacle for display
  };

  std::uint64_t seq = 0;      // 0 = never published
  rt::Time fused{};           // when it was made
  rt::Time exposure{};        // newest image in it: one that was claimed
  bool ground_found = false;  // false: every cell is unknown and nothing may be planned
  double resolution = 0.05;   // m a cell
  int width = 0, height = 0;  // cells along x and y
  Pose X_WM = Pose::Identity();
  std::array<std::uint8_t, static_cast<std::size_t>(kMaxCells) * kMaxCells>
      cost{};  // iy * width + ix
  std::array<float, static_cast<std::size_t>(kMaxCells) * kMaxCells>
      height_m{};  // highest surface; NaN unknown
  // Where something moves, was seen to move last, or is taken to reach to (moving_cells.hpp):
  // kOccupied in `cost`, the last kInscribed, with the inflation of an obstacle.
  static constexpr int kMaxMoving = 2048;
  struct Moving {
    std::uint16_t cell = 0;    // iy * width + ix
    std::uint16_t age_ms = 0;  // at `fused`, since its last sight
  };
  int moving_count = 0;
  std::array<Moving, kMaxMoving> moving{};

  [[nodiscard]] bool contains(int ix, int iy) const noexcept {
    return ix >= 0 && iy >= 0 && ix < width && iy < height;
  }
  [[nodiscard]] std::size_t index(int ix, int iy) const noexcept {
    return static_cast<std::size_t>(iy) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(ix);
  }
};

}  // namespace perception
