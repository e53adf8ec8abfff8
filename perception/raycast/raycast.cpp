#include "perception/raycast/raycast.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "perception/raycast/hint_kernel.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/clones.hpp"
#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/map_reader.hpp"

namespace perception {
namespace {

constexpr int kTileShift = 2, kTileEdge = 1 << kTileShift;
constexpr int kMaxSteps = 4096;  // a ray of 6 m at 2 mm voxels, twice over
constexpr float kNoTile = 1e9F;
constexpr int kMostParts = 8;
constexpr float kClose = 0.1F;  // voxels: a Newton step below it is the last

}  // namespace

class Caster {
 public:
  Caster(const TsdfMap& map, const Pose& X_WC, const RaycastOptions& o, RaycastMaps& out) noexcept
      : map_(map),
        reader_(map, o.min_weight),
        options_(o),
        out_(out),
        voxel_(map.voxel_size()),
        voxels_per_unit_(map.metres_per_unit() / static_cast<float>(voxel_)),
        stride_unknown_(static_cast<float>(
            std::max(1.0, std::floor(0.8 * std::min(5.0, map.truncation() / voxel_))))) {
    hint_reach_ = static_cast<float>(map.truncation() / voxel_);
    // Grid coordinates are kept relative to a node near the camera: floats then resolve microns.
    const Mat3 R = X_WC.linear();
    for (int r = 0; r < 3; ++r) {
      const double grid = X_WC.translation()(r) / voxel_;
      base_[r] = ifloor(grid) & ~63;
      origin_[r] = static_cast<float>(grid - base_[r]);
      for (int c = 0; c < 3; ++c) {
        R_[r][c] = static_cast<float>(R(r, c));
        axes_[c][r] = static_cast<float>(R(r, c) / voxel_);
      }
    }
  }

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
    const auto half = static_cast<float>(4.0 * voxel_),
               chunk_half = static_cast<float>(32.0 * voxel_);
    const auto far = static_cast<float>(options_.max_depth_m);
    for (int n = 0; n < map_.chunk_count(); ++n) {
      const TsdfMap::Chunk& c = map_.chunk(n);
      if (c.blocks == 0) continue;
      const BoxView whole =
          boxes.view((c.coord.x * 64 + 31.5) * voxel_, (c.coord.y * 64 + 31.5) * voxel_,
                     (c.coord.z * 64 + 31.5) * voxel_, chunk_half);
      if (!whole.visible || whole.z_near > far) continue;
      for (const std::int32_t b : c.block) {
        if (b == TsdfMap::kNoBlock) continue;
        const BlockCoord at = map_.block_coord(b);
        const BoxView box = boxes.view((at.x * 8 + 3.5) * voxel_, (at.y * 8 + 3.5) * voxel_,
                                       (at.z * 8 + 3.5) * voxel_, half);
        if (!box.visible || box.z_near > far) continue;
        for (int v = box.v0 >> kTileShift; v <= box.v1 >> kTileShift; ++v)
          for (int u = box.u0 >> kTileShift; u <= box.u1 >> kTileShift; ++u) {
            const auto tile = static_cast<std::size_t>(v * tiles_u + u);
            out_.near_m_[tile] = std::min(out_.near_m_[tile], box.z_near);
            out_.far_m_[tile] = std::max(out_.far_m_[tile], box.z_far);
          }
      }
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
      s.steps += caster.steps_;
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
      for (int i = 0; i < count; ++i)
        hint[i] = options_.hint_depth_m.at((u0 + i) * hint_step, v * hint_step);
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
      if (s.found[i] != 0 || hinted_only()) {
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
    const int middle[3] = {base_[0] >> 6, base_[1] >> 6, base_[2] >> 6};
    out_.directory_.fill(map_, middle);
    const TsdfMap::Arrays arrays = map_.arrays();
    HintJob job{};
    job.directory = out_.directory_.data();
    job.tables = arrays.tables;
    job.words = arrays.words;
    job.ahead = arrays.ahead;
    job.empty_table = arrays.empty_table;
    job.empty_block = arrays.empty_block;
    job.least_word = static_cast<std::uint32_t>(reader_.least_weight()) << 16U;
    for (int a = 0; a < 3; ++a) {
      job.base[a] = base_[a];
      job.origin[a] = origin_[a];
      job.corner[a] = out_.directory_.corner(a);
      for (int c = 0; c < 3; ++c) job.axes[c][a] = axes_[c][a], job.R[a][c] = R_[a][c];
    }
    job.reach = hint_reach_;
    job.first = static_cast<float>(options_.min_depth_m);
    job.last = static_cast<float>(options_.max_depth_m);
    return job;
  }

  // The reference of cast_hints(): one ray after the other, through the map's reader.
  TELETACT_CLONES __attribute__((flatten)) HintCount cast_hints_scalar(const HintSpan& s) noexcept {
    HintCount count;
    const std::int64_t before = steps_;
    for (int i = 0; i < s.count; ++i) {
      float* record = s.records + static_cast<std::ptrdiff_t>(i) * RaycastMaps::kStride;
      const Ray r = ray_of(s.x[i], s.y);
      const float near = hint_reach_ * r.voxel_t, hint = s.hint[i];
      float hit_t = 0;
      MapReader::Cell cell{};
      s.found[i] = hint > 0 && hint - near > static_cast<float>(options_.min_depth_m) &&
                   hint + near < static_cast<float>(options_.max_depth_m) &&
                   quick_root(r, hint - near, hint + near, hint, HintJob::kClose, hit_t, cell);
      const bool hit = s.found[i] != 0 && store(r, s.x[i], s.y, hit_t, cell, record);
      if (!hit) std::memset(record, 0, RaycastMaps::kStride * sizeof(float));
      count.hits += static_cast<int>(hit);
    }
    count.steps = steps_ - before;
    steps_ = before;
    return count;
  }

  // One ray in grid coordinates relative to base_, parameter t = depth along the optical axis.
  struct Ray {
    Float4 d, inverse;  // inverse: finite, huge where d is 0
    Float4 ahead;       // 1 where d > 0, else 0
    Float4 block_t;     // t from one block to the next along each axis
    Int4 positive;      // ahead as an integer
    float voxel_t;      // t of one voxel's length along the ray
  };

  [[nodiscard]] MapReader::Cell cell_at(const Ray& r, float t) noexcept {
    ++steps_;
    const Float4 p = origin_ + splat(t) * r.d;
    const Int4 n = floor4(p);
    const Float4 f = p - to_float(n);
    const Int4 node = n + base_;
    return reader_.cell(node[0], node[1], node[2], f[0], f[1], f[2]);
  }

  [[nodiscard]] Ray ray_of(float x, float y) const noexcept {
    Ray r{};
    r.d = splat(x) * axes_[0] + splat(y) * axes_[1] + axes_[2];
    for (int a = 0; a < 3; ++a) {
      r.positive[a] = r.d[a] > 0 ? 1 : 0;
      r.inverse[a] = std::fabs(r.d[a]) > 1e-9F ? 1.0F / r.d[a] : (r.d[a] > 0 ? 1e9F : -1e9F);
    }
    r.ahead = to_float(r.positive);
    for (int a = 0; a < 3; ++a) r.block_t[a] = 8.0F * std::fabs(r.inverse[a]);
    r.voxel_t = 1.0F / std::sqrt(r.d[0] * r.d[0] + r.d[1] * r.d[1] + r.d[2] * r.d[2]);
    return r;
  }

  // First crossing in the depth range of the ray's tile; with a hint (> 0) from 1.1 truncation in front
  // of it.
  bool cast_full(int u, int v, int tile, float hint, float* record) noexcept {
    const auto at = static_cast<std::size_t>(tile);
    float first = std::max(static_cast<float>(options_.min_depth_m), out_.near_m_[at]);
    const float last = std::min(static_cast<float>(options_.max_depth_m), out_.far_m_[at]);
    const float x = out_.x_[static_cast<std::size_t>(u)], y = row_y(v);
    const Ray r = ray_of(x, y);
    if (hint > 0) first = std::max(first, hint - 1.1F * hint_reach_ * r.voxel_t);
    float hit_t = 0;
    MapReader::Cell cell{};
    return march(r, first, last, hit_t, cell) && store(r, x, y, hit_t, cell, record);
  }

  enum class Side { kUnknown, kOutside, kInside };

  bool march(const Ray& r, float t, float end, float& hit_t, MapReader::Cell& cell) noexcept {
    Side before = Side::kUnknown;
    float before_t = t, before_d = 0, careful_until = -1;
    const Float4 half = splat(0.5F);
    for (int n = 0; n < kMaxSteps && t <= end; ++n) {
      ++steps_;
      const Int4 node = floor4(origin_ + splat(t) * r.d + half) + base_;
      const Int4 block = node >> 3;
      const std::uint32_t* words = reader_.block_of(block[0], block[1], block[2]);
      std::uint32_t word = 0;
      if (words != nullptr) word = words[TsdfMap::in_block(node[0], node[1], node[2])];
      const bool known = reader_.known(word);
      const auto d = static_cast<float>(TsdfMap::word_distance(word));
      if (known && d > 0) {
        before = Side::kOutside, before_t = t, before_d = d;
        const float jump = 0.8F * d * voxels_per_unit_;
        t += (jump < 1.0F || t < careful_until ? 1.0F : jump) * r.voxel_t;
        continue;
      }
      // A long step may have passed a thin band: go back and walk.
      if (before == Side::kOutside && t - before_t > 1.5F * r.voxel_t) {
        careful_until = t;
        t = before_t + r.voxel_t;
        continue;
      }
      if (known) {
        if (before == Side::kOutside &&
            quick_root(r, before_t, t, before_t + (t - before_t) * (before_d / (before_d - d)),
                       kClose, hit_t, cell))
          return true;
        if (before != Side::kInside &&
            crossing(r, std::max(before_t, t - (stride_unknown_ + 0.5F) * r.voxel_t), t, hit_t,
                     cell))
          return true;
        before = Side::kInside, before_t = t;
        t += r.voxel_t;
        continue;
      }
      before = Side::kUnknown, before_t = t;
      t = words == nullptr ? skip(r, node, t, end) : t + stride_unknown_ * r.voxel_t;
    }
    return false;
  }

  // From a point whose block is absent: t where the ray enters the next allocated block (or a little
  // before), or beyond `end`. Walks from block to block, over absent chunks in one stride. A block owns
  // the space nearest to its nodes.
  [[nodiscard]] float skip(const Ray& r, Int4 node, float t, float end) noexcept {
    if (reader_.chunk_of(node[0] >> 6, node[1] >> 6, node[2] >> 6) == nullptr) {
      const Float4 wall = wall_of(r, node & ~63, 64.0F);
      return std::max(std::min(std::min(wall[0], wall[1]), wall[2]), t) + 0.01F * r.voxel_t;
    }
    Float4 next = wall_of(r, node & ~7, 8.0F);
    Int4 block = node >> 3;
    for (int n = 0; n < 24; ++n) {
      const int a =
          next[0] <= next[1] ? (next[0] <= next[2] ? 0 : 2) : (next[1] <= next[2] ? 1 : 2);
      t = std::max(t, next[a]);
      if (t > end) return t;
      block[a] += r.positive[a] != 0 ? 1 : -1;
      next[a] += r.block_t[a];
      if (reader_.block_of(block[0], block[1], block[2]) != nullptr) break;
    }
    return t + 0.01F * r.voxel_t;
  }
  // t at which the ray crosses the far walls of the cube of `edge` nodes from `low`.
  [[nodiscard]] Float4 wall_of(const Ray& r, Int4 low, float edge) const noexcept {
    const Float4 far = to_float(low - base_) - splat(0.5F) + r.ahead * splat(edge);
    return (far - origin_) * r.inverse;
  }

  // The usual case: nearest nodes + and - at t0 and t1, a root of the interpolant close to `guess`.
  // Newton along the ray; taken only when it lands within the bracket (half a voxel wider: nodes are
  // not on the ray) in a known cell that falls along the ray there. Else crossing() looks closely.
  bool quick_root(const Ray& r, float t0, float t1, float guess, float close_vox, float& hit_t,
                  MapReader::Cell& cell) noexcept {
    const float low = t0 - 0.5F * r.voxel_t, high = t1 + 0.5F * r.voxel_t;
    float t = guess;
    for (int n = 0; n < HintJob::kNewton; ++n) {
      cell = cell_at(r, t);
      if (!cell.valid) return false;
      const float f = cell.value();
      float g[3];
      cell.gradient(g);
      const float slope = g[0] * r.d[0] + g[1] * r.d[1] + g[2] * r.d[2];  // raw units per t
      if (!(slope < 0)) return false;
      const float move = -f / slope;
      t += move;
      if (!(t >= low && t <= high)) return false;
      const float close = close_vox * r.voxel_t;
      if (move < close && move > -close) {
        hit_t = t;
        return true;
      }
    }
    return false;
  }

  // First + to - of the trilinear field from a little before t = a to a voxel behind b; both sides
  // known.
  bool crossing(const Ray& r, float a, float b, float& hit_t, MapReader::Cell& cell) noexcept {
    float t0 = a;
    MapReader::Cell c = cell_at(r, t0);
    // The nearest node was outside, the interpolant need not be: begin before the surface.
    for (int n = 0; n < 3 && c.valid && c.value() <= 0; ++n) {
      t0 -= 0.7F * r.voxel_t;
      c = cell_at(r, t0);
    }
    float f0 = c.valid ? c.value() : -1.0F;
    const float stop = b + 1.01F * r.voxel_t;
    float step = f0 > 0 ? b - t0 : 0.5F * r.voxel_t;  // the usual case: one interval does it
    if (step > 2.5F * r.voxel_t || step < 0.25F * r.voxel_t) step = 0.5F * r.voxel_t;
    while (t0 < stop) {
      const float t1 = t0 + step;
      c = cell_at(r, t1);
      const float f1 = c.valid ? c.value() : 1.0F;
      if (f0 > 0 && f1 <= 0) return refine(r, t0, f0, t1, f1, hit_t, cell);
      f0 = c.valid ? f1 : -1.0F;
      t0 = t1;
      step = 0.5F * r.voxel_t;
    }
    return false;
  }

  // Secant, and once more on the bracket it leaves. `cell` is the one the root was last tested in.
  bool refine(const Ray& r, float t0, float f0, float t1, float f1, float& hit_t,
              MapReader::Cell& cell) noexcept {
    const float t = t0 + (t1 - t0) * (f0 / (f0 - f1));
    cell = cell_at(r, t);
    if (!cell.valid) return false;
    const float f = cell.value();
    if (f > 0)
      hit_t = t + (t1 - t) * (f / (f - f1));
    else
      hit_t = f0 > f ? t0 + (t - t0) * (f0 / (f0 - f)) : t;
    return true;
  }

  // Averages the field's noise: of the cell three voxels wide round the hit's own; where that holds an
  // unknown or clipped node, of differences over one voxel to either side; false where neither is.
  bool smooth_gradient(const Ray& r, float t, float (&g)[3]) noexcept {
    const Float4 p = origin_ + splat(t) * r.d;
    const Int4 n = floor4(p), node = n + base_;
    const Float4 f = p - to_float(n), wide = (f + splat(1.0F)) * splat(1.0F / 3.0F);
    const MapReader::Cell w =
        reader_.wide_cell(node[0], node[1], node[2], wide[0], wide[1], wide[2]);
    if (w.valid && w.within(static_cast<float>(TsdfMap::kDistanceOne))) {
      w.gradient(g);
      return true;
    }
    for (int a = 0; a < 3; ++a) {
      Int4 lo = node, hi = node;
      --lo[a], ++hi[a];
      const MapReader::Cell c = reader_.cell(lo[0], lo[1], lo[2], f[0], f[1], f[2]);
      const MapReader::Cell d = reader_.cell(hi[0], hi[1], hi[2], f[0], f[1], f[2]);
      if (!c.valid || !d.valid) return false;
      g[a] = d.value() - c.value();
    }
    return true;
  }

  bool store(const Ray& r, float x, float y, float t, const MapReader::Cell& cell,
             float* record) noexcept {
    float g[3];
    if (!options_.smooth_normals || !smooth_gradient(r, t, g)) cell.gradient(g);
    float n[3];
    for (int c = 0; c < 3; ++c) n[c] = R_[0][c] * g[0] + R_[1][c] * g[1] + R_[2][c] * g[2];
    const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    // The field falls along the ray here, so the normal faces the camera or there is none.
    if (!(length > 0) || n[0] * x + n[1] * y + n[2] >= 0) return false;
    for (int c = 0; c < 3; ++c) record[c] = n[c] / length;
    record[3] = t;
    return true;
  }

  [[nodiscard]] Rgb colour_of(int u, int v, const float* record) noexcept {
    Rgb c;
    const double z = static_cast<double>(record[3]);
    const Vec3 p_C = out_.intrinsics.unproject(u, v, z);
    if (!reader_.colour(out_.X_WC * p_C, c)) return {128, 128, 128};
    return c;
  }

  const TsdfMap& map_;
  MapReader reader_;
  const RaycastOptions& options_;
  RaycastMaps& out_;
  double voxel_;
  float voxels_per_unit_;
  float stride_unknown_;  // voxels; the band across a surface is at least 5 thick
  float hint_reach_ = 0;  // voxels: one truncation
  Int4 base_{};
  Float4 origin_{};
  Float4 axes_[3]{};  // camera axes in grid units a metre
  float R_[3][3];
  std::int64_t steps_ = 0;
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

RaycastStats raycast(const TsdfMap& map, const Intrinsics& camera, const Pose& X_WC,
                     const RaycastOptions& options, RaycastMaps& out) noexcept {
  out.intrinsics = {};
  if (!camera.valid() || options.pixel_step < 1 || !X_WC.matrix().allFinite()) return {};
  const double reach = options.max_depth_m * 8 + X_WC.translation().cwiseAbs().maxCoeff();
  if (!(reach < 8.0 * TsdfMap::kMaxBlockCoord * map.voxel_size())) return {};
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
