// What stood in a cell whose floor is not in view, and is gone.
#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>

#include "perception/ground/ground_map.hpp"

namespace perception {

namespace {

// chosen on: moving 1 odd; judged on: moving 1 even
// The way to a cell may be seen through in one frame and be hidden in the next: what was seen free
// must be gone after ten.
constexpr int kThroughLoss = 2;

}  // namespace

// What lies below the floor is no part of the column: nothing sees through a hole.
std::uint32_t GroundMap::slice_of(float h) const noexcept {
  if (!(h >= 0)) return kHole;
  return 1U << static_cast<unsigned>(std::min(static_cast<int>(h * slices_per_m_), kSlices - 1));
}

// An occupied cell in which this frame meets neither floor nor obstacle loses evidence when every
// slice that an obstacle was met in has been seen through since, some of them in this frame: the
// reading at the slice's middle lies more than a cell beyond it. What is hidden, out of the image
// or without a reading may still be there.
void GroundMap::look_through(const GroundFrame& frame) noexcept {
  // What stood here may have gone on behind it: what moves is seen through to as well.
  const bool all = frame.all_m.width > 0;
  const Intrinsics& k = all ? frame.all_intrinsics : frame.intrinsics;
  const ImageView<const float>& depth_m = all ? frame.all_m : frame.depth_m;
  const Pose X_CM = (X_MW_ * frame.X_WC).inverse(Eigen::Isometry);
  const Eigen::Matrix3f R = X_CM.linear().cast<float>();
  const Vec3f t = X_CM.translation().cast<float>();
  const Vec3f tilt = correction_.cast<float>();
  const auto cell_m = static_cast<float>(config_.resolution_m);
  const auto fx = static_cast<float>(k.fx), fy = static_cast<float>(k.fy);
  const auto cx = static_cast<float>(k.cx + 0.5), cy = static_cast<float>(k.cy + 0.5);
  const auto per_m2 = static_cast<float>(config_.tolerance_per_m2);
  const auto near = static_cast<float>(config_.range_m) - 2 * cell_m;
  const auto width = static_cast<float>(k.width), height = static_cast<float>(k.height);
  const auto through = [&](const Vec3f& p_M) {
    const Vec3f q = R * p_M + t;
    if (!(q.z() > cell_m && q.z() < near)) return false;  // beyond, no obstacle is met either
    const float half = 0.5F * fx * cell_m / q.z();  // of a cell on the rim, some is in the image
    const float u = fx * q.x() / q.z() + cx, v = fy * q.y() / q.z() + cy;
    if (!(u >= -half && v >= -half && u < width + half && v < height + half)) return false;
    const int iu = static_cast<int>(std::clamp(u, 0.0F, width - 1)),
              iv = static_cast<int>(std::clamp(v, 0.0F, height - 1));
    return depth_m.at(iu, iv) > q.z() + cell_m + per_m2 * q.z() * q.z();  // none: 0
  };
  const int few = std::max(1, static_cast<int>(std::lround(256 * config_.obstacle_area)));
  std::uint64_t looks = 0;
  const std::size_t count = cells_.size();
  for (std::size_t first = 0; first < count; first += sizeof(std::uint64_t)) {
    std::uint64_t any = 0;
    const std::size_t end = std::min(first + sizeof any, count);
    std::memcpy(&any, occupied_.data() + first, end - first);
    if (any == 0) continue;
    for (std::size_t i = first; i < end; ++i) {
      Cell& c = cells_[i];
      if (occupied_[i] == 0 || c.slices == 0 || (c.slices & kHole) != 0 || c.ground_points > 0 ||
          4 * c.obstacle_area >= few)
        continue;
      const auto edge = static_cast<std::size_t>(config_.cells), row = i / edge;
      const float x = (static_cast<float>(i % edge) + 0.5F) * cell_m,
                  y = (static_cast<float>(row) + 0.5F) * cell_m;
      const float floor = tilt.x() + tilt.y() * x + tilt.z() * y;
      std::uint32_t seen = 0;
      for (std::uint32_t left = c.slices; left != 0; left &= left - 1, ++looks) {
        const float h = (static_cast<float>(std::countr_zero(left)) + 0.5F) / slices_per_m_;
        if (through({x, y, h + floor})) seen |= left & (~left + 1U);
      }
      c.through |= seen;
      if (seen == 0 || c.through != c.slices) continue;
      c.evidence = static_cast<std::uint8_t>(
          std::max<int>(c.evidence - kThroughLoss * config_.evidence_loss, 0));
      if (c.evidence >= config_.occupied_at) continue;
      occupied_[i] = 0;
      dirty_ = true;
      c.slices = c.through = 0;
      c.height = c.seen != 0 ? 0.0F : std::numeric_limits<float>::quiet_NaN();
    }
  }
  work_ += looks + count / sizeof(std::uint64_t);
}

}  // namespace perception
