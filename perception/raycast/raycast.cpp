#include "perception/raycast/raycast.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/map_reader.hpp"

namespace perception {
namespace {

constexpr int kTileShift = 3;
constexpr int kMaxSteps = 4096;  // a ray of 6 m at 2 mm voxels, twice over
constexpr float kNoTile = 1e9F;

}  // namespace

class Caster {
 public:
  Caster(const TsdfMap& map, const Pose& X_WC, const RaycastOptions& o,
         RaycastMaps& out) noexcept
      : map_(map), reader_(map, o.min_weight), options_(o), out_(out),
        voxel_(map.voxel_size()), inv_voxel_(1.0 / voxel_),
        voxels_per_unit_(static_cast<double>(map.metres_per_unit()) * inv_voxel_),
        stride_unknown_(std::max(1.0, std::floor(0.4 * map.truncation() * inv_voxel_))) {
    const Mat3 R = X_WC.linear();
    for (int r = 0; r < 3; ++r) {
      origin_[r] = X_WC.translation()(r) * inv_voxel_;
      for (int c = 0; c < 3; ++c) R_[r][c] = R(r, c);
    }
  }

  RaycastStats run() noexcept {
    const Intrinsics& k = out_.intrinsics;
    bound_tiles();
    const int tiles_u = (k.width + 7) >> kTileShift;
    RaycastStats stats;
    for (int v = 0; v < k.height; ++v) {
      float* record = out_.records_ + static_cast<std::ptrdiff_t>(v) * k.width * RaycastMaps::kStride;
      Rgb* colour = out_.colour_.data() + static_cast<std::ptrdiff_t>(v) * k.width;
      for (int u = 0; u < k.width; ++u, record += RaycastMaps::kStride) {
        const auto tile = static_cast<std::size_t>((v >> kTileShift) * tiles_u + (u >> kTileShift));
        const bool hit = out_.near_m_[tile] < kNoTile && cast(u, v, tile, record);
        if (!hit) std::memset(record, 0, RaycastMaps::kStride * sizeof(float));
        if (options_.colour) colour[u] = hit ? colour_of(record) : Rgb{};
        stats.hits += static_cast<int>(hit);
      }
    }
    stats.rays = k.width * k.height;
    stats.steps = steps_;
    return stats;
  }

 private:
  // Depth range of the allocated blocks that each tile of 8 x 8 rays can meet.
  void bound_tiles() noexcept {
    const Intrinsics& k = out_.intrinsics;
    const int tiles_u = (k.width + 7) >> kTileShift, tiles_v = (k.height + 7) >> kTileShift;
    const auto tiles = static_cast<std::size_t>(tiles_u) * static_cast<std::size_t>(tiles_v);
    std::fill_n(out_.near_m_.begin(), tiles, kNoTile);
    std::fill_n(out_.far_m_.begin(), tiles, 0.0F);
    const CameraBoxes boxes(k, out_.X_WC.inverse(Eigen::Isometry));
    const auto half = static_cast<float>(4.0 * voxel_), chunk_half = static_cast<float>(32.0 * voxel_);
    const auto far = static_cast<float>(options_.max_depth_m);
    for (int n = 0; n < map_.chunk_count(); ++n) {
      const TsdfMap::Chunk& c = map_.chunk(n);
      if (c.blocks == 0) continue;
      const BoxView whole = boxes.view((c.coord.x * 64 + 31.5) * voxel_, (c.coord.y * 64 + 31.5) * voxel_,
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

  // One ray in grid coordinates, parameter t = depth along the optical axis.
  struct Ray {
    double o[3], d[3], inv[3];
    double per_t;      // grid length of one unit of t
    double voxel_t;    // t of one voxel's length
  };

  [[nodiscard]] double leave(const Ray& r, const int (&low)[3], int edge) const noexcept {
    double t = 1e30;
    for (int a = 0; a < 3; ++a) {
      // Space nearest to the nodes low .. low + edge - 1.
      const double wall = r.d[a] > 0 ? low[a] + edge - 0.5 : low[a] - 0.5;
      if (r.d[a] != 0) t = std::min(t, (wall - r.o[a]) * r.inv[a]);
    }
    return t;
  }

  [[nodiscard]] MapReader::Cell cell_at(const Ray& r, double t) noexcept {
    return reader_.cell(r.o[0] + t * r.d[0], r.o[1] + t * r.d[1], r.o[2] + t * r.d[2]);
  }

  bool cast(int u, int v, std::size_t tile, float* record) noexcept {
    const Intrinsics& k = out_.intrinsics;
    const double x = (u - k.cx) / k.fx, y = (v - k.cy) / k.fy;
    Ray r;
    for (int a = 0; a < 3; ++a) {
      r.o[a] = origin_[a];
      r.d[a] = (R_[a][0] * x + R_[a][1] * y + R_[a][2]) * inv_voxel_;
      r.inv[a] = 1.0 / r.d[a];
    }
    r.per_t = std::sqrt(r.d[0] * r.d[0] + r.d[1] * r.d[1] + r.d[2] * r.d[2]);
    r.voxel_t = 1.0 / r.per_t;
    double t = std::max(options_.min_depth_m, static_cast<double>(out_.near_m_[tile]));
    const double end = std::min(options_.max_depth_m, static_cast<double>(out_.far_m_[tile]));
    if (options_.hint_depth_m.data != nullptr) {
      const auto hint = static_cast<double>(
          options_.hint_depth_m.at(u * options_.pixel_step, v * options_.pixel_step));
      const double start = hint - 1.1 * map_.truncation() * inv_voxel_ * r.voxel_t;
      if (hint > 0 && start > t) t = start;
    }
    double hit_t = 0;
    MapReader::Cell cell{};
    if (!march(r, t, end, hit_t, cell)) return false;
    return store(x, y, hit_t, cell, record);
  }

  enum class Side { kUnknown, kOutside, kInside };

  bool march(const Ray& r, double t, double end, double& hit_t, MapReader::Cell& cell) noexcept {
    Side before = Side::kUnknown;
    double before_t = t, careful_until = -1;
    for (int n = 0; n < kMaxSteps && t <= end; ++n) {
      ++steps_;
      const int node[3] = {ifloor(r.o[0] + t * r.d[0] + 0.5), ifloor(r.o[1] + t * r.d[1] + 0.5),
                           ifloor(r.o[2] + t * r.d[2] + 0.5)};
      const std::uint32_t* words = reader_.block_of(node[0] >> 3, node[1] >> 3, node[2] >> 3);
      const std::uint32_t word =
          words == nullptr ? 0U : words[TsdfMap::in_block(node[0], node[1], node[2])];
      const bool known = reader_.known(word);
      const int d = TsdfMap::word_distance(word);
      if (known && d > 0) {
        before = Side::kOutside, before_t = t;
        const double jump = 0.8 * d * voxels_per_unit_;
        t += (jump < 1.0 || t < careful_until ? 1.0 : jump) * r.voxel_t;
        continue;
      }
      // A long step may have passed a thin band: go back and walk.
      if (before == Side::kOutside && t - before_t > 1.5 * r.voxel_t) {
        careful_until = t;
        t = before_t + r.voxel_t;
        continue;
      }
      if (known) {
        if (before != Side::kInside && crossing(r, std::max(before_t, t - 2.5 * r.voxel_t), t, hit_t, cell))
          return true;
        before = Side::kInside, before_t = t;
        t += r.voxel_t;
        continue;
      }
      before = Side::kUnknown, before_t = t;
      t += words == nullptr ? skip(r, node, t) : stride_unknown_ * r.voxel_t;
    }
    return false;
  }

  // How far to the end of the absent block or chunk round `node`.
  [[nodiscard]] double skip(const Ray& r, const int (&node)[3], double t) noexcept {
    const bool chunk = reader_.chunk_of(node[0] >> 6, node[1] >> 6, node[2] >> 6) != nullptr;
    const int edge = chunk ? 8 : 64, mask = ~(edge - 1);
    const int low[3] = {node[0] & mask, node[1] & mask, node[2] & mask};
    return std::max(leave(r, low, edge) - t, 0.0) + 0.01 * r.voxel_t;
  }

  // First + to - of the trilinear field in [a, b + 1 voxel], both sides known.
  bool crossing(const Ray& r, double a, double b, double& hit_t, MapReader::Cell& cell) noexcept {
    double t0 = a;
    MapReader::Cell c = cell_at(r, t0);
    float f0 = c.valid ? c.value() : -1.0F;
    const double stop = b + 1.01 * r.voxel_t;
    double step = f0 > 0 ? b - a : 0.5 * r.voxel_t;  // the usual case: one interval does it
    if (step > 1.7 * r.voxel_t || step < 0.25 * r.voxel_t) step = 0.5 * r.voxel_t;
    while (t0 < stop) {
      const double t1 = t0 + step;
      ++steps_;
      c = cell_at(r, t1);
      const float f1 = c.valid ? c.value() : 1.0F;
      if (f0 > 0 && c.valid && f1 <= 0) return refine(r, t0, f0, t1, f1, hit_t, cell);
      f0 = c.valid ? f1 : -1.0F;
      t0 = t1;
      step = 0.5 * r.voxel_t;
    }
    return false;
  }

  bool refine(const Ray& r, double t0, float f0, double t1, float f1, double& hit_t,
              MapReader::Cell& cell) noexcept {
    for (int n = 0; n < 2; ++n) {
      const double t = t0 + (t1 - t0) * static_cast<double>(f0 / (f0 - f1));
      cell = cell_at(r, t);
      if (!cell.valid) return false;
      const float f = cell.value();
      if (f > 0) t0 = t, f0 = f;
      else t1 = t, f1 = f;
    }
    hit_t = f0 > f1 ? t0 + (t1 - t0) * static_cast<double>(f0 / (f0 - f1)) : t1;
    cell = cell_at(r, hit_t);
    return cell.valid;
  }

  bool store(double x, double y, double t, const MapReader::Cell& cell, float* record) noexcept {
    float g[3];
    cell.gradient(g);
    double n[3];
    for (int c = 0; c < 3; ++c)
      n[c] = R_[0][c] * static_cast<double>(g[0]) + R_[1][c] * static_cast<double>(g[1]) +
             R_[2][c] * static_cast<double>(g[2]);
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    // The field falls along the ray here, so the normal faces the camera or there is none.
    if (!(length > 0) || n[0] * x + n[1] * y + n[2] >= 0) return false;
    record[0] = static_cast<float>(x * t), record[1] = static_cast<float>(y * t);
    record[2] = record[3] = static_cast<float>(t);
    for (int c = 0; c < 3; ++c) record[4 + c] = static_cast<float>(n[c] / length);
    record[7] = 0;
    return true;
  }

  [[nodiscard]] Rgb colour_of(const float* record) noexcept {
    Rgb c{128, 128, 128};
    const Vec3 p_C = Vec3f(record).cast<double>();
    if (!reader_.colour(out_.X_WC * p_C, c)) return {128, 128, 128};
    return c;
  }

  const TsdfMap& map_;
  MapReader reader_;
  const RaycastOptions& options_;
  RaycastMaps& out_;
  double voxel_, inv_voxel_, voxels_per_unit_, stride_unknown_;
  double origin_[3], R_[3][3];
  std::int64_t steps_ = 0;
};

RaycastMaps::RaycastMaps(rt::NonRealtime&, int width, int height)
    : capacity_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
      storage_(capacity_ * kStride + 8), colour_(capacity_) {
  const auto address = reinterpret_cast<std::uintptr_t>(storage_.data());
  records_ = storage_.data() + ((32 - address % 32) % 32) / sizeof(float);
  // Any shape with that many rays: a tile row more each way covers the rounding.
  const std::size_t tiles = capacity_ / 64 + 2 * (static_cast<std::size_t>(width + height) / 8 + 2);
  near_m_.resize(tiles);
  far_m_.resize(tiles);
}

RaycastStats raycast(const TsdfMap& map, const Intrinsics& camera, const Pose& X_WC,
                     const RaycastOptions& options, RaycastMaps& out) noexcept {
  out.intrinsics = {};
  if (!camera.valid() || options.pixel_step < 1 || !X_WC.matrix().allFinite()) return {};
  const double reach = options.max_depth_m * 8 + X_WC.translation().cwiseAbs().maxCoeff();
  if (!(reach < 8.0 * TsdfMap::kMaxBlockCoord * map.voxel_size())) return {};
  const Intrinsics k = camera.subsampled(options.pixel_step);
  if (!out.fits(k.width, k.height)) return {};
  if (options.hint_depth_m.data != nullptr && (options.hint_depth_m.width != camera.width ||
                                               options.hint_depth_m.height != camera.height))
    return {};
  out.intrinsics = k;
  out.X_WC = X_WC;
  return Caster(map, X_WC, options, out).run();
}

}  // namespace perception
