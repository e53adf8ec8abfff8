#include "perception/tsdf/integrate/kept_volume.hpp"

#include <algorithm>
#include <cmath>

#include "perception/geometry/ifloor.hpp"

namespace perception {

void KeptVolume::place(const Pose& X_WC, double edge_m, double voxel) noexcept {
  const int blocks = std::max(1, static_cast<int>(std::lround(edge_m / (8 * voxel))));
  const Vec3 centre_W = X_WC * Vec3(0, 0, 0.5 * edge_m);
  for (std::size_t a = 0; a < 3; ++a) {
    const double middle = centre_W(static_cast<Eigen::Index>(a)) / (8 * voxel);
    first_[a] = 8 * ifloor(middle - 0.5 * blocks + 0.5);
    end_[a] = first_[a] + 8 * blocks;
  }
  bounded_ = true;
}

}  // namespace perception
