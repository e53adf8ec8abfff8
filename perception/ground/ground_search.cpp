// Where the ground is, and the grid on it: the first claimed frames (ground_map.hpp, "find").
#include <algorithm>
#include <cmath>
#include <numbers>

#include "perception/ground/ground_map.hpp"

namespace perception {

namespace {

constexpr double kDegree = std::numbers::pi / 180;

}  // namespace

void GroundMap::search(const GroundFrame& frame) noexcept {
  const Intrinsics& k = frame.intrinsics;
  const double pixels = static_cast<double>(k.width) * k.height;
  const auto most = static_cast<double>(points_.size());
  const int stride = std::max(1, static_cast<int>(std::ceil(std::sqrt(pixels / most))));
  std::size_t n = 0;
  for (int v = stride / 2; v < k.height; v += stride) {
    for (int u = stride / 2; u < k.width && n < points_.size(); u += stride) {
      const auto z = static_cast<double>(frame.depth_m.at(u, v));
      if (z > 0 && z <= config_.range_m) {
        points_[n++] = (frame.X_WC * k.unproject(u, v, z)).cast<float>();
      }
    }
  }
  work_ += n * static_cast<std::uint64_t>(config_.plane.draws) / 2;
  GroundHint hint;
  hint.up_known = prior_.up_known;
  hint.up = prior_.up_known ? prior_.up_W : Vec3(-frame.X_WC.linear().col(1));
  hint.camera_height_m = prior_.camera_height_m;
  const Vec3 camera = frame.X_WC.translation();
  const auto plane = find_ground({points_.data(), n}, camera, hint, config_.plane, searches_++);
  if (!plane) {
    agreeing_ = 0;
    return;
  }
  const bool agrees = agreeing_ > 0 &&
                      plane->normal.dot(candidate_W_.normal) > std::cos(3 * kDegree) &&
                      std::abs(plane->height(camera) - candidate_W_.height(camera)) < 0.03;
  if (!agrees) {
    candidate_W_ = *plane;
    agreeing_ = 1;
  } else {
    // Running mean of the agreeing frames.
    const double w = 1.0 / (agreeing_ + 1);
    candidate_W_.normal = ((1 - w) * candidate_W_.normal + w * plane->normal).normalized();
    candidate_W_.offset = (1 - w) * candidate_W_.offset + w * plane->offset;
    candidate_W_.rms_m = plane->rms_m;
    candidate_W_.inliers = plane->inliers;
    candidate_W_.share = plane->share;
    candidate_W_.below = plane->below;
    ++agreeing_;
  }
  if (agreeing_ >= config_.plane.frames) {
    plane_W_ = candidate_W_;
    found_ = true;
    fix_grid();
  }
}

void GroundMap::fix_grid() noexcept {
  const Vec3 z = plane_W_.normal;
  const Vec3 along = std::abs(z.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 x = (along - along.dot(z) * z).normalized();
  Mat3 R;
  R.col(0) = x;
  R.col(1) = z.cross(x);
  R.col(2) = z;
  const Vec3 start = prior_.start_W - plane_W_.height(prior_.start_W) * z;  // on the plane
  const double half = 0.5 * config_.cells * config_.resolution_m;
  X_WM_ = Pose::Identity();
  X_WM_.linear() = R;
  X_WM_.translation() = start - R * Vec3(half, half, 0);
  X_MW_ = X_WM_.inverse();
  // The robot stands at the middle: see START DISC in the header.
  const double r = config_.start_radius_m / config_.resolution_m;
  const double middle = config_.cells / 2.0;
  for (int iy = 0; iy < config_.cells && r > 0; ++iy) {
    for (int ix = 0; ix < config_.cells; ++ix) {
      if (std::hypot(ix + 0.5 - middle, iy + 0.5 - middle) > r) continue;
      Cell& c = cells_[static_cast<std::size_t>(iy * config_.cells + ix)];
      c.seen = 1;
      c.height = 0;
    }
  }
  draw_virtual();
}

}  // namespace perception
