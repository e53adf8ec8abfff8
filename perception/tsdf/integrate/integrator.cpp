#include "perception/tsdf/integrate/integrator.hpp"

#include <algorithm>
#include <array>
#include <cmath>

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
  return X_WC.translation().cwiseAbs().maxCoeff() < voxel * 8 * MapLayout::kMaxBlockCoord / 2;
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

Integrator::Integrator(rt::NonRealtime& nrt, MapStore& store, Pager& pager, ViewedBlocks& viewed)
    : store_(store),
      pager_(pager),
      viewed_(viewed),
      pyramid_(nrt),
      allocator_(nrt, store, pager, volume_, pyramid_),
      follower_(nrt, store, pyramid_),
      carver_(nrt, store, allocator_, volume_, pyramid_),
      range_weight_(store.config.weighting == "range") {}

IntegrateStats Integrator::integrate(const FrameView& frame, const Pose& X_WC,
                                     int pixel_step) noexcept {
  IntegrateStats stats;
  if (pixel_step < 1 || (pixel_step & (pixel_step - 1)) != 0 ||
      !usable(frame, X_WC, store_.voxel)) {
    stats.refused = true;
    return stats;
  }
  const TsdfConfig& config = store_.config;
  if (config.volume_m > 0 && !volume_.bounded()) volume_.place(X_WC, config.volume_m, store_.voxel);
  frame_ += frame_ == 0 ? 2 : 1;  // a chunk's 0 is never the last frame
  store_.blocks.next_revision();
  const DepthRule rule{
      static_cast<float>(config.min_depth_m),
      static_cast<float>(config.max_depth_m),
      static_cast<float>(config.edge_base_m),
      static_cast<float>(config.edge_per_m),
      static_cast<float>(frame.intrinsics.fx),
      static_cast<float>(frame.intrinsics.fy),
      static_cast<float>(frame.intrinsics.cx),
      static_cast<float>(frame.intrinsics.cy),
      static_cast<float>(std::min(1.0, kThinnestVox * store_.voxel / store_.truncation)),
      range_weight_};
  const std::int64_t begin = profiling_ ? cpu_ns(*crew_) : 0;
  stats.pixels = pyramid_.build(frame.depth_mm, rule, *crew_, frame.moving);
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const FrameCamera view{frame, X_WC, X_CW, CameraBoxes(frame.intrinsics, X_CW)};
  if (pager_.far_store().size() > 0) {  // page() has seen to it before, but for a camera that leapt
    PageStats paged;
    pager_.fetch_boxes(view.boxes, X_WC.translation(), config.max_blocks, false, paged);
    stats.blocks_fetched = paged.blocks_moved;
  }
  const std::int64_t ready = profiling_ ? cpu_ns(*crew_) : 0;
  allocator_.allocate_band(view, pixel_step, *crew_, stats);
  follow(view, stats);
  const std::int64_t allocated = profiling_ ? cpu_ns(*crew_) : 0;
  update_blocks(view, stats);
  const std::int64_t updated = profiling_ ? cpu_ns(*crew_) : 0;
  carver_.carve(view, frame_, *crew_, stats);
  if (profiling_)
    times_ = {ready - begin, allocated - ready, updated - allocated, cpu_ns(*crew_) - updated};
  return stats;
}

void Integrator::follow(const FrameCamera& view, IntegrateStats& stats) noexcept {
  if (!store_.config.follow) return;
  const FollowCounts counts = follower_.step(view, frame_, viewed_.X_CW());
  stats.blocks_moved += counts.blocks_moved;
  stats.follow_tests += counts.tests;
}

int Integrator::find_in_view(const FrameCamera& view) noexcept {
  const double voxel = store_.voxel;
  const auto reach =
      static_cast<float>(store_.truncation * DepthPyramid::kReachMost / DepthPyramid::kReachOne) +
      1e-4F;
  const auto block_half = static_cast<float>(3.5 * voxel),
             chunk_half = static_cast<float>(31.5 * voxel);
  const auto far = static_cast<float>(store_.config.max_depth_m) + reach;
  const BlockPool& blocks = store_.blocks;
  int count = 0;
  for (int n = 0; n < blocks.chunk_count(); ++n) {
    const MapLayout::Chunk& c = blocks.chunk(n);
    if (c.blocks == 0) continue;
    const BoxView whole =
        view.boxes.view((c.coord.x * 64 + 31.5) * voxel, (c.coord.y * 64 + 31.5) * voxel,
                        (c.coord.z * 64 + 31.5) * voxel, chunk_half);
    if (!whole.visible || whole.z_near > far) continue;
    for (std::size_t slot = 0; slot < MapLayout::kChunkBlocks; ++slot) {
      const std::int32_t b = c.block[slot];
      if (b == MapLayout::kNoBlock) continue;
      const BlockCoord at = blocks.coord(b);
      const BoxView box = view.boxes.view((at.x * 8 + 3.5) * voxel, (at.y * 8 + 3.5) * voxel,
                                          (at.z * 8 + 3.5) * voxel, block_half);
      if (!box.visible || box.z_near > far) continue;
      const auto range = pyramid_.range(box.u0, box.v0, box.u1, box.v1);
      if (static_cast<float>(range.greatest_mm) * 1e-3F + reach < box.z_near) continue;  // hidden
      const bool inside = box.inside && box.z_near >= CameraBoxes::kLeastZ;
      viewed_.set(count++, {b, inside});
    }
  }
  return count;
}

void Integrator::update_blocks(const FrameCamera& view, IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  UpdateCamera cam = update_camera(store_, pyramid_, k, view.X_CW);
  static_assert(sizeof(Rgb) == 3);
  const bool coloured = view.frame.colour.data != nullptr;
  // At least a voxel: a node beside the surface takes colour, which the mesh reads as "seen here".
  cam.colour_band_m =
      coloured ? static_cast<float>(std::max(store_.config.colour_band_m, store_.voxel)) : -1.0F;
  cam.colour = reinterpret_cast<const std::uint8_t*>(view.frame.colour.data);
  cam.colour_stride_px = view.frame.colour.stride;
  const int count = find_in_view(view);
  viewed_.tell(count, k, view.X_CW);
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

// Of those in view, `first` .. `last` - 1. A block's memory is asked for while those before it are
// worked on.
void Integrator::update_range(const FrameCamera& view, const UpdateCamera& cam, int first, int last,
                              IntegrateStats& stats) noexcept {
  constexpr int kLead = 2;
  BlockPool& blocks = store_.blocks;
  for (int n = first; n < last; ++n) {
    const ViewedBlocks::InView seen = viewed_.at(n);
    const std::int32_t b = seen.block, ahead = viewed_.at(std::min(n + kLead, last - 1)).block;
    __builtin_prefetch(blocks.free_bits(ahead), 1);
    float p0[3];
    first_node_C(view.X_CW, store_.voxel, blocks.coord(b), p0);
    const BlockCounts counts = update_block(
        cam, p0, seen.inside,
        {blocks.words(b), blocks.free_bits(b), blocks.colours(b), blocks.words(ahead)});
    if ((counts.fused | counts.carved) != 0) blocks.mark_changed(b);
    ++stats.blocks_updated;
    stats.voxels_fused += counts.fused;
    stats.voxels_carved += counts.carved;
  }
}

}  // namespace perception
