// The layers of the cost map: what the operator drew, and the distance to what is occupied
// (ground_map.hpp, "layers").
#include <algorithm>
#include <cmath>

#include "perception/ground/ground_map.hpp"

namespace perception {

namespace {

constexpr std::uint8_t kDrawn = 1;  // in drawn_: by the operator

}  // namespace

void GroundMap::draw_virtual() noexcept {
  for (std::uint8_t& d : drawn_) d = static_cast<std::uint8_t>(d & ~kDrawn);
  dirty_ = true;
  const double margin = config_.resolution_m / 2;  // a cell that the shape touches counts
  for (int n = 0; n < virtual_count_; ++n) {
    const VirtualObstacle& o = virtual_[static_cast<std::size_t>(n)];
    const Vec3 centre = X_MW_ * o.centre_W;
    const double c = std::cos(o.yaw_rad), s = std::sin(o.yaw_rad);
    for (int iy = 0; iy < config_.cells; ++iy) {
      for (int ix = 0; ix < config_.cells; ++ix) {
        const double dx = (ix + 0.5) * config_.resolution_m - centre.x();
        const double dy = (iy + 0.5) * config_.resolution_m - centre.y();
        const bool inside = o.kind == VirtualObstacle::Kind::kDisc
                                ? std::hypot(dx, dy) <= o.radius_m + margin
                                : std::abs(c * dx + s * dy) <= o.half_x_m + margin &&
                                      std::abs(c * dy - s * dx) <= o.half_y_m + margin;
        if (inside) drawn_[static_cast<std::size_t>(iy * config_.cells + ix)] |= kDrawn;
      }
    }
  }
  work_ += cells_.size() * static_cast<std::uint64_t>(virtual_count_ + 1);
}

void GroundMap::inflate() noexcept {
  const int n = config_.cells, pad = reach_, stride = n + 2 * pad;
  const auto cap = static_cast<std::uint16_t>(reach_ + 1);
  const auto cap2 = static_cast<std::uint16_t>(cap * cap);
  // Distance along y, two sweeps over whole rows; margins stay at the cap.
  std::fill(column_.begin(), column_.end(), cap);
  const auto row = [&](int y) {
    return column_.data() + static_cast<std::ptrdiff_t>(y) * stride + pad;
  };
  for (int y = 0; y < n; ++y) {
    std::uint16_t* d = row(y);
    const std::uint16_t* before = y > 0 ? row(y - 1) : nullptr;
    const std::uint8_t* o = occupied_.data() + static_cast<std::ptrdiff_t>(y) * n;
    const std::uint8_t* w = drawn_.data() + static_cast<std::ptrdiff_t>(y) * n;
    for (int x = 0; x < n; ++x) {
      const int up = before != nullptr ? std::min(before[x] + 1, static_cast<int>(cap)) : cap;
      d[x] = static_cast<std::uint16_t>((o[x] | w[x]) != 0 ? 0 : up);
    }
  }
  for (int y = n - 2; y >= 0; --y) {
    std::uint16_t* d = row(y);
    const std::uint16_t* after = row(y + 1);
    for (int x = 0; x < n; ++x) {
      d[x] = static_cast<std::uint16_t>(std::min<int>(d[x], after[x] + 1));
    }
  }
  for (std::uint16_t& d : column_) d = static_cast<std::uint16_t>(d * d);
  for (int y = 0; y < n; ++y) {
    std::uint16_t* out = distance2_.data() + static_cast<std::ptrdiff_t>(y) * n;
    std::fill_n(out, n, cap2);
    for (int dx = -reach_; dx <= reach_; ++dx) {
      const auto add = static_cast<std::uint16_t>(dx * dx);
      const std::uint16_t* in = row(y) + dx;
      for (int x = 0; x < n; ++x) {
        const auto d2 = static_cast<std::uint16_t>(in[x] + add);
        out[x] = d2 < out[x] ? d2 : out[x];
      }
    }
  }
  dirty_ = false;
  work_ += cells_.size() * static_cast<std::uint64_t>(2 * reach_ + 3) / 16;
}

}  // namespace perception
