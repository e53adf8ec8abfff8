// The stages of one integrate(): ready the image, allocate the band, update what is in view, carve.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>

#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/voxel_update.hpp"

namespace perception {
namespace {

bool usable(const FrameView& f, const Pose& X_WC, double voxel) noexcept {
  const Intrinsics& k = f.intrinsics;
  if (!k.valid() || !std::isfinite(k.fx + k.fy + k.cx + k.cy)) return false;
  if (k.width > DepthPyramid::kMaxWidth || k.height > DepthPyramid::kMaxHeight) return false;
  if (f.depth_mm.data == nullptr || f.depth_mm.width != k.width || f.depth_mm.height != k.height)
    return false;
  if (f.colour.data != nullptr && (f.colour.width != k.width || f.colour.height != k.height))
    return false;
  if (!X_WC.matrix().allFinite()) return false;
  const Mat3 R = X_WC.linear();
  if ((R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff() > 1e-3 || R.determinant() < 0)
    return false;
  // Leave room for the longest ray, so that no coordinate overflows.
  return X_WC.translation().cwiseAbs().maxCoeff() < voxel * 8 * TsdfMap::kMaxBlockCoord / 2;
}

std::int64_t cpu_ns() noexcept {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec * 1000000000LL + t.tv_nsec;
}

// The band is at least this thick to either side across the surface, also at grazing angles: a cell
// cut by the surface then has eight known corners.
constexpr double kThinnestVox = 2.5;

// Running mean of a colour in bytes, rounded; the weight is capped so that a change is still learned.
constexpr std::uint32_t kColourCap = 15;
struct Reciprocals {
  std::uint32_t of[kColourCap + 2];
};
constexpr Reciprocals make_reciprocals() {
  Reciprocals r{};
  for (std::uint32_t n = 1; n < kColourCap + 2; ++n) r.of[n] = (65536 + n - 1) / n;
  return r;
}
constexpr Reciprocals kReciprocal = make_reciprocals();

std::uint32_t blend_colour(std::uint32_t old, Rgb c) noexcept {
  const std::uint32_t n = old >> 24U, sum = n + 1, half = sum / 2;
  const auto mean = [&](std::uint32_t was, std::uint32_t now) {
    return ((was * n + now + half) * kReciprocal.of[sum]) >> 16U;  // exact: the sum is below 2^12
  };
  return mean(old & 0xffU, c.r) | (mean((old >> 8U) & 0xffU, c.g) << 8U) |
         (mean((old >> 16U) & 0xffU, c.b) << 16U) | (std::min(sum, kColourCap) << 24U);
}

}  // namespace

IntegrateStats TsdfMap::integrate(const FrameView& frame, const Pose& X_WC,
                                  int pixel_step) noexcept {
  IntegrateStats stats;
  if (pixel_step < 1 || !usable(frame, X_WC, voxel_)) {
    stats.refused = true;
    return stats;
  }
  const DepthRule rule{static_cast<float>(config_.min_depth_m),
                       static_cast<float>(config_.max_depth_m),
                       static_cast<float>(config_.edge_base_m),
                       static_cast<float>(config_.edge_per_m),
                       static_cast<float>(frame.intrinsics.fx),
                       static_cast<float>(frame.intrinsics.fy),
                       static_cast<float>(frame.intrinsics.cx),
                       static_cast<float>(frame.intrinsics.cy),
                       static_cast<float>(std::min(1.0, kThinnestVox * voxel_ / truncation_)),
                       range_weight_};
  const std::int64_t begin = profiling_ ? cpu_ns() : 0;
  stats.pixels = pyramid_.build(frame.depth_mm, rule);
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const View view{frame, X_WC, X_CW, CameraBoxes(frame.intrinsics, X_CW)};
  const std::int64_t ready = profiling_ ? cpu_ns() : 0;
  allocate_band(view, pixel_step, stats);
  const std::int64_t allocated = profiling_ ? cpu_ns() : 0;
  update_blocks(view, stats);
  const std::int64_t updated = profiling_ ? cpu_ns() : 0;
  carve(view, stats);
  if (profiling_)
    times_ = {ready - begin, allocated - ready, updated - allocated, cpu_ns() - updated};
  return stats;
}

void TsdfMap::allocate_band(const View& view, int pixel_step, IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  const double per_block = 1.0 / (8.0 * voxel_);
  const double shift = 1.0 / 16.0;  // half a voxel: a block owns the space nearest to its nodes
  const Vec3 origin = view.X_WC.translation() * per_block + Vec3::Constant(shift);
  const Mat3 R = view.X_WC.linear() * per_block;
  Chunk* near = nullptr;
  std::array<int, 6> last{};
  bool have_last = false;
  for (int v = 0; v < k.height; v += pixel_step) {
    const std::uint32_t* row = pyramid_.pixels() + static_cast<std::ptrdiff_t>(v) * k.width;
    const double y = (v - k.cy) / k.fy;
    for (int u = 0; u < k.width; u += pixel_step) {
      if (((row[u] >> 16U) & 0xffU) == 0) continue;
      ++stats.rays;
      const double z = (row[u] & 0xffffU) * 1e-3, x = (u - k.cx) / k.fx;
      const double half =
          truncation_ * (row[u] >> 24U) / DepthPyramid::kReachOne / std::sqrt(1.0 + x * x + y * y);
      const double dir[3] = {R(0, 0) * x + R(0, 1) * y + R(0, 2),
                             R(1, 0) * x + R(1, 1) * y + R(1, 2),
                             R(2, 0) * x + R(2, 1) * y + R(2, 2)};
      double q0[3], q1[3];
      std::array<int, 6> ends{};
      int steps = 0;
      for (std::size_t a = 0; a < 3; ++a) {
        q0[a] = origin(static_cast<Eigen::Index>(a)) + (z - half) * dir[a];
        q1[a] = origin(static_cast<Eigen::Index>(a)) + (z + half) * dir[a];
        ends[a] = ifloor(q0[a]), ends[a + 3] = ifloor(q1[a]);
        steps += std::abs(ends[a + 3] - ends[a]);
      }
      // The same two ends with nothing between them: the neighbour has been here.
      if (have_last && steps <= 1 && ends == last) continue;
      last = ends, have_last = true;
      int b[3] = {ends[0], ends[1], ends[2]};
      near = touch_block(b[0], b[1], b[2], near, stats);
      if (steps == 0) continue;
      double t[3], dt[3];
      int sign[3];
      for (std::size_t a = 0; a < 3; ++a) {
        const double d = q1[a] - q0[a];
        sign[a] = d > 0 ? 1 : -1;
        const bool moves = ends[a + 3] != ends[a];
        dt[a] = moves ? 1.0 / std::fabs(d) : 0.0;
        t[a] = moves ? (d > 0 ? b[a] + 1 - q0[a] : q0[a] - b[a]) * dt[a] : 1e30;
      }
      for (int s = 0; s < steps; ++s) {
        const std::size_t a = t[0] <= t[1] ? (t[0] <= t[2] ? 0U : 2U) : (t[1] <= t[2] ? 1U : 2U);
        b[a] += sign[a];
        t[a] = b[a] == ends[a + 3] ? 1e30 : t[a] + dt[a];  // ends exactly in the last block
        near = touch_block(b[0], b[1], b[2], near, stats);
      }
    }
  }
}

void TsdfMap::update_blocks(const View& view, IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  UpdateCamera cam{};
  cam.fx = static_cast<float>(k.fx), cam.fy = static_cast<float>(k.fy);
  cam.cx = static_cast<float>(k.cx), cam.cy = static_cast<float>(k.cy);
  cam.width = k.width, cam.height = k.height;
  cam.pixels = pyramid_.pixels();
  cam.truncation_m = static_cast<float>(truncation_);
  cam.units_per_m = static_cast<float>(kDistanceOne / truncation_);
  cam.weight_cap = static_cast<std::int32_t>(config_.max_weight * kWeightOne);
  cam.colour_band_m =
      view.frame.colour.data != nullptr ? static_cast<float>(config_.colour_band_m) : -1.0F;
  const Mat3 step = view.X_CW.linear() * voxel_;
  for (int r = 0; r < 3; ++r) {
    cam.dx[r] = static_cast<float>(step(r, 0));
    cam.dy[r] = static_cast<float>(step(r, 1));
    cam.dz[r] = static_cast<float>(step(r, 2));
  }
  const auto reach =
      static_cast<float>(truncation_ * DepthPyramid::kReachMost / DepthPyramid::kReachOne) + 1e-4F;
  const auto block_half = static_cast<float>(3.5 * voxel_),
             chunk_half = static_cast<float>(31.5 * voxel_);
  const auto far = static_cast<float>(config_.max_depth_m) + reach;
  for (int n = 0; n < chunk_count_; ++n) {
    const Chunk& c = chunks_[static_cast<std::size_t>(n)];
    if (c.blocks == 0) continue;
    const BoxView whole =
        view.boxes.view((c.coord.x * 64 + 31.5) * voxel_, (c.coord.y * 64 + 31.5) * voxel_,
                        (c.coord.z * 64 + 31.5) * voxel_, chunk_half);
    if (!whole.visible || whole.z_near > far) continue;
    for (std::size_t slot = 0; slot < kChunkBlocks; ++slot) {
      const std::int32_t b = c.block[slot];
      if (b == kNoBlock) continue;
      const BlockCoord at = coords_[static_cast<std::size_t>(b)];
      const BoxView box = view.boxes.view((at.x * 8 + 3.5) * voxel_, (at.y * 8 + 3.5) * voxel_,
                                          (at.z * 8 + 3.5) * voxel_, block_half);
      if (!box.visible || box.z_near > far) continue;
      const auto range = pyramid_.range(box.u0, box.v0, box.u1, box.v1);
      if (static_cast<float>(range.greatest_mm) * 1e-3F + reach < box.z_near) continue;  // hidden
      update_one(view, cam, b, stats);
    }
  }
}

void TsdfMap::update_one(const View& view, const UpdateCamera& cam, std::int32_t b,
                         IntegrateStats& stats) noexcept {
  const BlockCoord at = coords_[static_cast<std::size_t>(b)];
  const Vec3 first_C = view.X_CW * (voxel_ * Vec3(8.0 * at.x, 8.0 * at.y, 8.0 * at.z));
  const float p0[3] = {static_cast<float>(first_C.x()), static_cast<float>(first_C.y()),
                       static_cast<float>(first_C.z())};
  const std::size_t base = static_cast<std::size_t>(b) * kBlockVoxels;
  const BlockCounts n = update_block(cam, p0, words_.data() + base,
                                     free_.data() + static_cast<std::size_t>(b) * 8, *scratch_);
  ++stats.blocks_updated;
  stats.voxels_fused += n.fused;
  stats.voxels_carved += n.carved;
  if (!n.coloured) return;
  const Rgb* colour = view.frame.colour.data;
  const auto stride = view.frame.colour.stride, width = view.frame.intrinsics.width;
  for (std::size_t v = 0; v < kBlockVoxels; ++v) {
    if (scratch_->near[v] == 0) continue;
    const std::int32_t p = scratch_->pixel[v];
    const Rgb c = stride == width ? colour[p] : view.frame.colour.at(p % width, p / width);
    colours_[base + v] = blend_colour(colours_[base + v], c);
  }
}

}  // namespace perception
