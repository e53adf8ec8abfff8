#include "perception/raycast/raycast.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "perception/geometry/no_colour.hpp"
#include "perception/raycast/hint_kernel.hpp"
#include "perception/raycast/ray_march.hpp"
#include "perception/simd/clones.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"

namespace perception {
namespace {

constexpr int kTileShift = 2, kTileEdge = 1 << kTileShift;
constexpr float kNoTile = 1e9F;
constexpr int kMostParts = 8;

}  // namespace

class Caster {
 public:
  Caster(const MapView& map, const Pose& X_WC, const RaycastOptions& o, RaycastMaps& out) noexcept
      : map_(map), march_(map, X_WC, o.min_weight, o.smooth_normals), options_(o), out_(out) {}

  RaycastStats run() noexcept {
    if (!hinted_only()) bound_tiles();
    const Intrinsics& k = out_.intrinsics;
    for (int u = 0; u < k.width; ++u)
      out_.x_[static_cast<std::size_t>(u)] = static_cast<float>((u - k.cx) / k.fx);
    RaycastStats stats;
    if (options_.hint_depth_m.data != nullptr)
      cast_hinted(stats);
    else
      cast_tiles(stats);
    stats.rays = k.width * k.height;
    return stats;
  }

 private:
  // Depth range of the allocated blocks that each tile of 4 x 4 rays can meet.
  void bound_tiles() noexcept {
    const Intrinsics& k = out_.intrinsics;
    const int tiles_u = (k.width + kTileEdge - 1) >> kTileShift,
              tiles_v = (k.height + kTileEdge - 1) >> kTileShift;
    const auto tiles = static_cast<std::size_t>(tiles_u) * static_cast<std::size_t>(tiles_v);
    std::fill_n(out_.near_m_.begin(), tiles, kNoTile);
    std::fill_n(out_.far_m_.begin(), tiles, 0.0F);
    const CameraBoxes boxes(k, out_.X_WC.inverse(Eigen::Isometry));
    const double voxel = map_.voxel_size();
    const auto half = static_cast<float>(4.0 * voxel),
               chunk_half = static_cast<float>(32.0 * voxel);
    const auto far = static_cast<float>(options_.max_depth_m);
    for (int n = 0; n < map_.chunk_count(); ++n) {
      const MapLayout::Chunk& c = map_.chunk(n);
      if (c.blocks == 0) continue;
      const BoxView whole =
          boxes.view((c.coord.x * 64 + 31.5) * voxel, (c.coord.y * 64 + 31.5) * voxel,
                     (c.coord.z * 64 + 31.5) * voxel, chunk_half);
      if (!whole.visible || whole.z_near > far) continue;
      for (const std::int32_t b : c.block) {
        if (b == MapLayout::kNoBlock) continue;
        const BlockCoord at = map_.block_coord(b);
        const BoxView box = boxes.view((at.x * 8 + 3.5) * voxel, (at.y * 8 + 3.5) * voxel,
                                       (at.z * 8 + 3.5) * voxel, half);
        if (!box.visible || box.z_near > far) continue;
        for (int v = box.v0 >> kTileShift; v <= box.v1 >> kTileShift; ++v)
          widen_row(v * tiles_u, box, out_.near_m_.data(), out_.far_m_.data());
      }
    }
  }

  // The two bounds do not overlap. Unsaid, the program tests it for every block and row, which
  // takes more or fewer instructions by which of the two the allocator put first.
  static void widen_row(int row, const BoxView& box, float* __restrict near_m,
                        float* __restrict far_m) noexcept {
    for (int tile = row + (box.u0 >> kTileShift); tile <= row + (box.u1 >> kTileShift); ++tile) {
      near_m[tile] = std::min(near_m[tile], box.z_near);
      far_m[tile] = std::max(far_m[tile], box.z_far);
    }
  }

  // Parts of the image, each by a caster of its own: a reader remembers what it read last.
  template <class Fn>
  void in_parts(int parts, RaycastStats& stats, Fn&& fn) noexcept {
    std::array<RaycastStats, kMostParts> part{};
    options_.crew->for_parts(parts, [&](int p) {
      Caster caster(map_, out_.X_WC, options_, out_);
      RaycastStats& s = part[static_cast<std::size_t>(p)];
      fn(caster, p, s);
      s.steps += caster.march_.steps();
    });
    for (const RaycastStats& s : part) stats.hits += s.hits, stats.steps += s.steps;
  }

  // Tile by tile: neighbouring rays read the same cache lines.
  void cast_tiles(RaycastStats& stats) noexcept {
    const Intrinsics& k = out_.intrinsics;
    const int tiles_u = (k.width + kTileEdge - 1) >> kTileShift,
              tiles_v = (k.height + kTileEdge - 1) >> kTileShift;
    in_parts(kMostParts, stats, [&](Caster& caster, int p, RaycastStats& s) {
      for (int n = tiles_v * p / kMostParts * tiles_u; n < tiles_v * (p + 1) / kMostParts * tiles_u;
           ++n)
        s.hits += caster.cast_tile(n % tiles_u, n / tiles_u, n);
    });
  }

  TELETACT_CLONES __attribute__((flatten)) int cast_tile(int tile_u, int tile_v,
                                                         int tile) noexcept {
    const Intrinsics& k = out_.intrinsics;
    const float near = out_.near_m_[static_cast<std::size_t>(tile)];
    const int v1 = std::min((tile_v + 1) << kTileShift, k.height);
    const int u1 = std::min((tile_u + 1) << kTileShift, k.width);
    int hits = 0;
    for (int v = tile_v << kTileShift; v < v1; ++v)
      for (int u = tile_u << kTileShift; u < u1; ++u) {
        const auto at = static_cast<std::ptrdiff_t>(v) * k.width + u;
        float* record = out_.records_ + at * RaycastMaps::kStride;
        hits += finish(u, v, near < kNoTile && cast_full(u, v, tile, 0.0F, record), record);
      }
    return hits;
  }

  // Column strips of rays: from row to row they read the same blocks.
  void cast_hinted(RaycastStats& stats) noexcept {
    const Intrinsics& k = out_.intrinsics;
    const bool vectors = simd::chosen() != simd::Isa::kScalar && !options_.smooth_normals;
    const HintJob job = hint_job();
    const int strips = (k.width + HintJob::kSpan - 1) / HintJob::kSpan;
    in_parts(std::min(strips, kMostParts), stats, [&](Caster& caster, int p, RaycastStats& s) {
      for (int n = p; n < strips; n += kMostParts)
        caster.cast_strip(job, vectors, n * HintJob::kSpan, s);
    });
  }

  void cast_strip(const HintJob& job, bool vectors, int u0, RaycastStats& stats) noexcept {
    const Intrinsics& k = out_.intrinsics;
    const int hint_step = options_.hint_depth_m.width == k.width ? 1 : options_.pixel_step;
    alignas(64) float hint[HintJob::kSpan];
    alignas(64) std::uint8_t found[HintJob::kSpan];
    const int count = std::min(HintJob::kSpan, k.width - u0);
    std::fill(std::begin(hint), std::end(hint), 0.0F);
    for (int v = 0; v < k.height; ++v) {
      const float* const row = options_.hint_depth_m.row(v * hint_step) + u0 * hint_step;
      if (hint_step == 1)
        std::copy_n(row, count, hint);
      else
        for (int i = 0; i < count; ++i) hint[i] = row[i * hint_step];
      float* records =
          out_.records_ + (static_cast<std::ptrdiff_t>(v) * k.width + u0) * RaycastMaps::kStride;
      const HintSpan span{hint, out_.x_.data() + u0, row_y(v), count, records, found};
      const HintCount n = vectors ? cast_hints(job, span) : cast_hints_scalar(span);
      stats.hits += n.hits;
      stats.steps += n.steps;
      if (!hinted_only() || options_.colour) stats.hits += finish_span(u0, v, span);
    }
  }

  // What the hint did not settle is cast in full; then colour.
  TELETACT_CLONES __attribute__((flatten)) int finish_span(int u0, int v,
                                                           const HintSpan& s) noexcept {
    const int tiles_u = (out_.intrinsics.width + kTileEdge - 1) >> kTileShift;
    int hits = 0;
    for (int i = 0; i < s.count; ++i) {
      float* record = s.records + static_cast<std::ptrdiff_t>(i) * RaycastMaps::kStride;
      if (s.found[i] != 0 || s.hint[i] < 0 || hinted_only()) {
        if (options_.colour) static_cast<void>(finish(u0 + i, v, record[3] > 0, record));
        continue;
      }
      const int tile = (v >> kTileShift) * tiles_u + ((u0 + i) >> kTileShift);
      const bool hit = out_.near_m_[static_cast<std::size_t>(tile)] < kNoTile &&
                       cast_full(u0 + i, v, tile, s.hint[i], record);
      hits += finish(u0 + i, v, hit, record);
    }
    return hits;
  }

  int finish(int u, int v, bool hit, float* record) noexcept {
    if (!hit) std::memset(record, 0, RaycastMaps::kStride * sizeof(float));
    if (options_.colour) {
      const auto at = static_cast<std::ptrdiff_t>(v) * out_.intrinsics.width + u;
      out_.colour_[static_cast<std::size_t>(at)] = hit ? colour_of(u, v, record) : Rgb{};
    }
    return static_cast<int>(hit);
  }

  [[nodiscard]] bool hinted_only() const noexcept {
    return options_.hinted_only && options_.hint_depth_m.data != nullptr;
  }
  [[nodiscard]] float row_y(int v) const noexcept {
    const Intrinsics& k = out_.intrinsics;
    return static_cast<float>((v - k.cy) / k.fy);
  }

  [[nodiscard]] HintJob hint_job() noexcept {
    HintJob job{};
    march_.describe(job);
    const int middle[3] = {job.base[0] >> 6, job.base[1] >> 6, job.base[2] >> 6};
    out_.directory_.fill(map_, middle);
    const MapLayout::Arrays arrays = map_.arrays();
    job.directory = out_.directory_.data();
    job.tables = arrays.tables;
    job.words = arrays.words;
    job.ahead = arrays.ahead;
    job.empty_table = arrays.empty_table;
    job.empty_block = arrays.empty_block;
    for (int a = 0; a < 3; ++a) job.corner[a] = out_.directory_.corner(a);
    job.first = static_cast<float>(options_.min_depth_m);
    job.last = static_cast<float>(options_.max_depth_m);
    return job;
  }

  // The reference of cast_hints(): one ray after the other, through the map's reader, which counts
  // the steps.
  TELETACT_CLONES __attribute__((flatten)) HintCount cast_hints_scalar(const HintSpan& s) noexcept {
    HintCount count;
    for (int i = 0; i < s.count; ++i) {
      float* record = s.records + static_cast<std::ptrdiff_t>(i) * RaycastMaps::kStride;
      const RayMarcher::Ray r = march_.ray_of(s.x[i], s.y);
      const float near = march_.reach() * r.voxel_t, hint = s.hint[i];
      float hit_t = 0;
      MapReader::Cell cell{};
      s.found[i] =
          hint > 0 && hint - near > static_cast<float>(options_.min_depth_m) &&
          hint + near < static_cast<float>(options_.max_depth_m) &&
          march_.quick_root(r, hint - near, hint + near, hint, HintJob::kClose, hit_t, cell);
      const bool hit = s.found[i] != 0 && march_.store(r, s.x[i], s.y, hit_t, cell, record);
      if (!hit) std::memset(record, 0, RaycastMaps::kStride * sizeof(float));
      count.hits += static_cast<int>(hit);
    }
    return count;
  }

  // First crossing in the depth range of the ray's tile; with a hint (> 0) from 1.1 truncation in
  // front of it.
  bool cast_full(int u, int v, int tile, float hint, float* record) noexcept {
    const auto at = static_cast<std::size_t>(tile);
    float first = std::max(static_cast<float>(options_.min_depth_m), out_.near_m_[at]);
    const float last = std::min(static_cast<float>(options_.max_depth_m), out_.far_m_[at]);
    const float x = out_.x_[static_cast<std::size_t>(u)], y = row_y(v);
    const RayMarcher::Ray r = march_.ray_of(x, y);
    if (hint > 0) first = std::max(first, hint - 1.1F * march_.reach() * r.voxel_t);
    float hit_t = 0;
    MapReader::Cell cell{};
    return march_.march(r, first, last, hit_t, cell) && march_.store(r, x, y, hit_t, cell, record);
  }

  [[nodiscard]] Rgb colour_of(int u, int v, const float* record) noexcept {
    Rgb c;
    const double z = static_cast<double>(record[3]);
    const Vec3 p_C = out_.intrinsics.unproject(u, v, z);
    if (!march_.reader().colour(out_.X_WC * p_C, c)) return kNeutral;
    return c;
  }

  MapView map_;
  RayMarcher march_;
  const RaycastOptions& options_;
  RaycastMaps& out_;
};

RaycastMaps::RaycastMaps(rt::NonRealtime& nrt, int width, int height)
    : directory_(nrt),
      capacity_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
      storage_(capacity_ * kStride + 16),
      colour_(capacity_),
      labels_(capacity_) {
  const auto address = reinterpret_cast<std::uintptr_t>(storage_.data());
  records_ = storage_.data() + ((64 - address % 64) % 64) / sizeof(float);
  // Any shape with that many rays: a tile row more each way covers the rounding.
  const std::size_t tiles = capacity_ / 16 + 2 * (static_cast<std::size_t>(width + height) / 4 + 2);
  near_m_.resize(tiles);
  far_m_.resize(tiles);
  x_.resize(capacity_ + HintJob::kSpan);
}

RaycastStats raycast(const MapView& map, const Intrinsics& camera, const Pose& X_WC,
                     const RaycastOptions& options, RaycastMaps& out) noexcept {
  out.intrinsics = {};
  if (!camera.valid() || options.pixel_step < 1 || !X_WC.matrix().allFinite()) return {};
  const double reach = options.max_depth_m * 8 + X_WC.translation().cwiseAbs().maxCoeff();
  if (!(reach < 8.0 * MapLayout::kMaxBlockCoord * map.voxel_size())) return {};
  const Intrinsics k = camera.subsampled(options.pixel_step);
  if (!out.fits(k.width, k.height)) return {};
  const auto& hint = options.hint_depth_m;
  if (hint.data != nullptr && (hint.width != camera.width || hint.height != camera.height) &&
      (hint.width != k.width || hint.height != k.height))
    return {};
  out.intrinsics = k;
  out.X_WC = X_WC;
  const RaycastStats stats = Caster(map, X_WC, options, out).run();
  if (options.labels) out.find_labels(map);
  return stats;
}

}  // namespace perception
