// With volume_m the map is limited to a cube of whole blocks, parallel to the grid. Its centre lies
// half an edge in front of the first camera whose frame was fused. Units: nodes.
#pragma once

#include <array>
#include <cstddef>

#include "perception/geometry/pose.hpp"

namespace perception {

class KeptVolume {
 public:
  // False: everything is kept.
  [[nodiscard]] bool bounded() const noexcept { return bounded_; }
  // X_WC: that camera. edge, voxel: m.
  void place(const Pose& X_WC, double edge_m, double voxel) noexcept;
  void clear() noexcept { bounded_ = false; }

  // Whether any, or all, of an aligned cube of nodes (first node, edge) may be kept. Only if
  // bounded.
  [[nodiscard]] bool meets(const std::array<int, 3>& node0, int edge) const noexcept {
    for (std::size_t a = 0; a < 3; ++a)
      if (node0[a] + edge <= first_[a] || node0[a] >= end_[a]) return false;
    return true;
  }
  [[nodiscard]] bool holds(const std::array<int, 3>& node0, int edge) const noexcept {
    for (std::size_t a = 0; a < 3; ++a)
      if (node0[a] < first_[a] || node0[a] + edge > end_[a]) return false;
    return true;
  }

 private:
  bool bounded_ = false;
  std::array<int, 3> first_{}, end_{};  // multiples of 8
};

}  // namespace perception
