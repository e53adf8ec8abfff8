// The stages of one integrate(): ready the image, allocate the band, update what is in view, carve.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "perception/simd/isa.hpp"
#include "perception/tsdf/image/frame_view.hpp"
#include "perception/tsdf/integrate/allocate_scratch.hpp"
#include "perception/tsdf/kernels/voxel_update.hpp"
#include "rt/clock/box_time.hpp"

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
  if (f.moving.data != nullptr && (f.moving.width != k.width || f.moving.height != k.height))
    return false;
  if (!X_WC.matrix().allFinite()) return false;
  const Mat3 R = X_WC.linear();
  if ((R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff() > 1e-3 || R.determinant() < 0)
    return false;
  // Leave room for the longest ray, so that no coordinate overflows.
  return X_WC.translation().cwiseAbs().maxCoeff() < voxel * 8 * TsdfMap::kMaxBlockCoord / 2;
}

// The way through: the caller's CPU, and where others took longer theirs.
std::int64_t cpu_ns(const rt::ForkJoin& crew) noexcept {
  return rt::thread_cpu_ns() + crew.beyond_ns();
}

// The band is at least this thick to either side across the surface, also at grazing angles: a cell
// cut by the surface then has eight known corners.
constexpr double kThinnestVox = 2.5;

constexpr int kUpdateParts = 16;

}  // namespace

IntegrateStats TsdfMap::integrate(const FrameView& frame, const Pose& X_WC,
                                  int pixel_step) noexcept {
  IntegrateStats stats;
  if (pixel_step < 1 || (pixel_step & (pixel_step - 1)) != 0 || !usable(frame, X_WC, voxel_)) {
    stats.refused = true;
    return stats;
  }
  if (config_.volume_m > 0 && !bounded_) place_volume(X_WC);
  frame_ += frame_ == 0 ? 2 : 1;  // a chunk's 0 is never the last frame
  ++revision_;
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
  const std::int64_t begin = profiling_ ? cpu_ns(*crew_) : 0;
  stats.pixels = pyramid_.build(frame.depth_mm, rule, *crew_, frame.moving);
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const View view{frame, X_WC, X_CW, CameraBoxes(frame.intrinsics, X_CW)};
  if (far_.size() > 0) {  // page() has seen to it before, but for a camera that leapt
    PageStats paged;
    fetch_boxes(view.boxes, X_WC.translation(), config_.max_blocks, false, paged);
    stats.blocks_fetched = paged.blocks_moved;
  }
  const std::int64_t ready = profiling_ ? cpu_ns(*crew_) : 0;
  allocate_band(view, pixel_step, stats);
  follow(view, stats);
  const std::int64_t allocated = profiling_ ? cpu_ns(*crew_) : 0;
  update_blocks(view, stats);
  const std::int64_t updated = profiling_ ? cpu_ns(*crew_) : 0;
  carve(view, stats);
  if (profiling_)
    times_ = {ready - begin, allocated - ready, updated - allocated, cpu_ns(*crew_) - updated};
  return stats;
}

void TsdfMap::place_volume(const Pose& X_WC) noexcept {
  const int blocks = std::max(1, static_cast<int>(std::lround(config_.volume_m / (8 * voxel_))));
  const Vec3 centre_W = X_WC * Vec3(0, 0, 0.5 * config_.volume_m);
  for (std::size_t a = 0; a < 3; ++a) {
    const double middle = centre_W(static_cast<Eigen::Index>(a)) / (8 * voxel_);
    volume_first_[a] = 8 * ifloor(middle - 0.5 * blocks + 0.5);
    volume_end_[a] = volume_first_[a] + 8 * blocks;
  }
  bounded_ = true;
}

bool TsdfMap::meets_volume(const std::array<int, 3>& node0, int edge) const noexcept {
  for (std::size_t a = 0; a < 3; ++a)
    if (node0[a] + edge <= volume_first_[a] || node0[a] >= volume_end_[a]) return false;
  return true;
}

bool TsdfMap::in_volume(const std::array<int, 3>& node0, int edge) const noexcept {
  for (std::size_t a = 0; a < 3; ++a)
    if (node0[a] < volume_first_[a] || node0[a] + edge > volume_end_[a]) return false;
  return true;
}

// What the rows of a band lack, up to where its room ends.
void TsdfMap::find_in_band(const View& view, const BandJob& job, int pixel_step, int skip,
                           int band) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  AllocateScratch& scratch = *allocate_;
  AllocateScratch::Band& out = scratch.bands[static_cast<std::size_t>(band)];
  const int rows = (k.height + pixel_step - 1) / pixel_step,
            rays = (k.width + pixel_step - 1) / pixel_step;
  std::uint32_t end = 0;
  out.rows_seen = out.rays = 0;
  const int last = AllocateScratch::last_row(rows, band);
  for (int r = AllocateScratch::first_row(rows, band) + skip;
       r < last && end + AllocateScratch::kMostARow <= out.keys.size(); ++r) {
    const int v = r * pixel_step;
    const std::uint32_t* pixels = pyramid_.pixels() + static_cast<std::ptrdiff_t>(v) * k.width;
    if (pixel_step > 1) {  // no lane of a vector without a ray
      for (int n = 0; n < rays; ++n)
        out.pixels[static_cast<std::size_t>(n)] = pixels[n * pixel_step];
      pixels = out.pixels.data();
    }
    const BandRow row{pixels, scratch.x.data(), static_cast<float>((v - k.cy) / k.fy), rays,
                      out.keys.data() + end};
    const BandCount n = find_missing(job, row);
    std::uint64_t* const begin = out.keys.data() + end;
    std::sort(begin, begin + n.found);
    end += static_cast<std::uint32_t>(std::unique(begin, begin + n.found) - begin);
    ++out.rows_seen;
    out.rays += n.rays;
  }
  out.end = end;
}

// Bands of rows at once: what do they lack? Then row by row it is made, in the order of block coordinates; what
// an earlier row has made by then is there already. So the result does not depend on how many rays or
// rows are looked at together. Where much is new (a first image) a band has no room for all its rows: it
// goes over the rest again.
void TsdfMap::allocate_band(const View& view, int pixel_step, IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  const double per_block = 1.0 / (8.0 * voxel_);
  const double shift = 1.0 / 16.0;  // half a voxel: a block owns the space nearest to its nodes
  BandJob job{};
  int middle[3];
  for (int a = 0; a < 3; ++a) {
    const double origin = view.X_WC.translation()(a) * per_block + shift;
    job.base[a] = ifloor(origin);
    job.origin[a] = static_cast<float>(origin - job.base[a]);
    middle[a] = job.base[a] >> 3;
    for (int c = 0; c < 3; ++c)
      job.axes[c][a] = static_cast<float>(view.X_WC.linear()(a, c) * per_block);
  }
  directory_.fill(*this, middle);
  for (int a = 0; a < 3; ++a) job.corner[a] = directory_.corner(a);
  job.directory = directory_.data();
  job.tables = arrays().tables;
  job.truncation_m = static_cast<float>(truncation_);
  AllocateScratch& scratch = *allocate_;
  for (int n = 0; n * pixel_step < k.width; ++n)
    scratch.x[static_cast<std::size_t>(n)] = static_cast<float>((n * pixel_step - k.cx) / k.fx);
  Chunk* near = nullptr;
  crew_->for_parts(AllocateScratch::kBands,
                   [&](int band) { find_in_band(view, job, pixel_step, 0, band); });
  const int rows = (k.height + pixel_step - 1) / pixel_step;
  for (int band = 0; band < AllocateScratch::kBands; ++band) {
    const int count =
        AllocateScratch::last_row(rows, band) - AllocateScratch::first_row(rows, band);
    const AllocateScratch::Band& found = scratch.bands[static_cast<std::size_t>(band)];
    for (int done = 0; done < count;) {
      if (done > 0) find_in_band(view, job, pixel_step, done, band);
      for (std::uint32_t n = 0; n < found.end; ++n) {
        const std::uint64_t key = found.keys[n];
        near = touch_block(block_key_axis(key, 0), block_key_axis(key, 1), block_key_axis(key, 2),
                           near, stats);
      }
      done += found.rows_seen;
      stats.rays += found.rays;
    }
  }
}

// Without colour.
UpdateCamera TsdfMap::update_camera(const Intrinsics& k, const Pose& X_CW) const noexcept {
  UpdateCamera cam{};
  cam.fx = static_cast<float>(k.fx), cam.fy = static_cast<float>(k.fy);
  cam.cx_half = static_cast<float>(k.cx + 0.5), cam.cy_half = static_cast<float>(k.cy + 0.5);
  cam.width = k.width, cam.height = k.height;
  cam.pixels = pyramid_.pixels();
  cam.gather = simd::gathers();
  cam.truncation_m = static_cast<float>(truncation_);
  cam.units_per_m = static_cast<float>(kDistanceOne / truncation_);
  cam.weight_cap = static_cast<std::int32_t>(config_.max_weight * kWeightOne);
  cam.colour_band_m = -1.0F;
  const Mat3 step = X_CW.linear() * voxel_;
  const auto along = [&step](int axis) {
    return std::array{static_cast<float>(step(0, axis)), static_cast<float>(step(1, axis)),
                      static_cast<float>(step(2, axis))};
  };
  cam.place_nodes(along(0), along(1), along(2));
  return cam;
}

void TsdfMap::update_blocks(const View& view, IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  UpdateCamera cam = update_camera(k, view.X_CW);
  static_assert(sizeof(Rgb) == 3);
  const bool coloured = view.frame.colour.data != nullptr;
  // At least a voxel: a node beside the surface takes colour, which the mesh reads as "seen here".
  cam.colour_band_m =
      coloured ? static_cast<float>(std::max(config_.colour_band_m, voxel_)) : -1.0F;
  cam.colour = reinterpret_cast<const std::uint8_t*>(view.frame.colour.data);
  cam.colour_stride_px = view.frame.colour.stride;
  const auto reach =
      static_cast<float>(truncation_ * DepthPyramid::kReachMost / DepthPyramid::kReachOne) + 1e-4F;
  const auto block_half = static_cast<float>(3.5 * voxel_),
             chunk_half = static_cast<float>(31.5 * voxel_);
  const auto far = static_cast<float>(config_.max_depth_m) + reach;
  int count = 0;
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
      const bool inside = box.inside && box.z_near >= CameraBoxes::kLeastZ;
      in_view_[static_cast<std::size_t>(count++)] = {b, inside};
    }
  }
  in_view_count_ = count;
  last_camera_ = k;
  X_CW_last_ = view.X_CW;
  std::array<IntegrateStats, kUpdateParts> part{};
  crew_->for_parts(kUpdateParts, [&](int p) {
    update_range(view, cam, count * p / kUpdateParts, count * (p + 1) / kUpdateParts,
                 part[static_cast<std::size_t>(p)]);
  });
  for (const IntegrateStats& s : part) {
    stats.blocks_updated += s.blocks_updated;
    stats.voxels_fused += s.voxels_fused;
    stats.voxels_carved += s.voxels_carved;
  }
}

// Of in_view_, `first` .. `last` - 1. A block's memory is asked for while those before it are worked on.
void TsdfMap::update_range(const View& view, const UpdateCamera& cam, int first, int last,
                           IntegrateStats& stats) noexcept {
  constexpr int kLead = 2;
  const auto words_of = [this](std::size_t b) { return words_.data() + b * kBlockVoxels; };
  const auto free_of = [this](std::size_t b) { return free_.data() + b * 8; };
  for (int n = first; n < last; ++n) {
    const InView seen = in_view_[static_cast<std::size_t>(n)];
    const auto b = static_cast<std::size_t>(seen.block);
    const auto ahead = static_cast<std::size_t>(
        in_view_[static_cast<std::size_t>(std::min(n + kLead, last - 1))].block);
    __builtin_prefetch(free_of(ahead), 1);
    const BlockCoord at = coords_[b];
    const Vec3 first_C = view.X_CW * (voxel_ * Vec3(8.0 * at.x, 8.0 * at.y, 8.0 * at.z));
    const float p0[3] = {static_cast<float>(first_C.x()), static_cast<float>(first_C.y()),
                         static_cast<float>(first_C.z())};
    const BlockCounts counts = update_block(
        cam, p0, seen.inside,
        {words_of(b), free_of(b), colours_.data() + b * kBlockVoxels, words_of(ahead)});
    if ((counts.fused | counts.carved) != 0) changed_[b] = revision_;
    ++stats.blocks_updated;
    stats.voxels_fused += counts.fused;
    stats.voxels_carved += counts.carved;
  }
}

}  // namespace perception
