// Follows one ray through the map to its first crossing of a surface. Each part of a cast
// (raycast.cpp) has its own marcher, because its reader caches the last blocks. All is inline, so
// that the casters' loops are compiled with it for each instruction set.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "perception/raycast/hint_kernel.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/blocks/map_view.hpp"

namespace perception {

class RayMarcher {
 public:
  static constexpr float kClose = 0.1F;   // voxels: a Newton step below it is the last
  static constexpr int kMaxSteps = 4096;  // a ray of 6 m at 2 mm voxels, twice over

  RayMarcher(const MapView& map, const Pose& X_WC, double min_weight, bool smooth_normals) noexcept
      : reader_(map, min_weight),
        smooth_normals_(smooth_normals),
        voxels_per_unit_(map.metres_per_unit() / static_cast<float>(map.voxel_size())),
        stride_unknown_(static_cast<float>(
            std::max(1.0, std::floor(0.8 * std::min(5.0, map.truncation() / map.voxel_size()))))),
        reach_(static_cast<float>(map.truncation() / map.voxel_size())) {
    // Grid coordinates are kept relative to a node near the camera: floats then resolve microns.
    const Mat3 R = X_WC.linear();
    for (int r = 0; r < 3; ++r) {
      const double grid = X_WC.translation()(r) / map.voxel_size();
      base_[r] = ifloor(grid) & ~63;
      origin_[r] = static_cast<float>(grid - base_[r]);
      for (int c = 0; c < 3; ++c) {
        R_[r][c] = static_cast<float>(R(r, c));
        axes_[c][r] = static_cast<float>(R(r, c) / map.voxel_size());
      }
    }
  }

  // One ray in grid coordinates relative to base_, parameter t = depth along the optical axis.
  struct Ray {
    Float4 d, inverse;  // inverse: finite, huge where d is 0
    Float4 ahead;       // 1 where d > 0, else 0
    Float4 block_t;     // t from one block to the next along each axis
    Int4 positive;      // ahead as an integer
    float voxel_t;      // t of one voxel's length along the ray
  };

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

  // First crossing between depths t and end.
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
      if (words != nullptr) word = words[MapLayout::in_block(node[0], node[1], node[2])];
      const bool known = reader_.known(word);
      const auto d = static_cast<float>(MapLayout::word_distance(word));
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

  // The usual case: nearest nodes + and - at t0 and t1, a root of the interpolant close to `guess`.
  // Newton along the ray; taken only when it lands within the bracket (half a voxel wider: nodes
  // are not on the ray) in a known cell that falls along the ray there. Else crossing() looks
  // closely.
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

  // The record of a hit at t in `cell`; x, y: of its pixel. False: its normal faces away.
  bool store(const Ray& r, float x, float y, float t, const MapReader::Cell& cell,
             float* record) noexcept {
    float g[3];
    if (!smooth_normals_ || !smooth_gradient(r, t, g)) cell.gradient(g);
    float n[3];
    for (int c = 0; c < 3; ++c) n[c] = R_[0][c] * g[0] + R_[1][c] * g[1] + R_[2][c] * g[2];
    const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    // The field falls along the ray here, so the normal faces the camera or there is none.
    if (!(length > 0) || n[0] * x + n[1] * y + n[2] >= 0) return false;
    for (int c = 0; c < 3; ++c) record[c] = n[c] / length;
    record[3] = t;
    return true;
  }

  [[nodiscard]] MapReader& reader() noexcept { return reader_; }
  [[nodiscard]] float reach() const noexcept { return reach_; }  // voxels: one truncation
  // Work: cells and nodes read so far.
  [[nodiscard]] std::int64_t steps() const noexcept { return steps_; }
  // What a vector kernel needs to do the same.
  void describe(HintJob& job) const noexcept {
    job.least_word = static_cast<std::uint32_t>(reader_.least_weight()) << 16U;
    for (int a = 0; a < 3; ++a) {
      job.base[a] = base_[a];
      job.origin[a] = origin_[a];
      for (int c = 0; c < 3; ++c) job.axes[c][a] = axes_[c][a], job.R[a][c] = R_[a][c];
    }
    job.reach = reach_;
  }

 private:
  enum class Side { kUnknown, kOutside, kInside };

  [[nodiscard]] MapReader::Cell cell_at(const Ray& r, float t) noexcept {
    ++steps_;
    const Float4 p = origin_ + splat(t) * r.d;
    const Int4 n = floor4(p);
    const Float4 f = p - to_float(n);
    const Int4 node = n + base_;
    return reader_.cell(node[0], node[1], node[2], f[0], f[1], f[2]);
  }

  // From a point whose block is absent: t where the ray enters the next allocated block (or a
  // little before), or beyond `end`. Walks from block to block, over absent chunks in one stride. A
  // block owns the space nearest to its nodes.
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

  // Averages the field's noise: of the cell three voxels wide round the hit's own; where that holds
  // an unknown or clipped node, of differences over one voxel to either side; false where neither
  // is.
  bool smooth_gradient(const Ray& r, float t, float (&g)[3]) noexcept {
    const Float4 p = origin_ + splat(t) * r.d;
    const Int4 n = floor4(p), node = n + base_;
    const Float4 f = p - to_float(n), wide = (f + splat(1.0F)) * splat(1.0F / 3.0F);
    const MapReader::Cell w =
        reader_.wide_cell(node[0], node[1], node[2], wide[0], wide[1], wide[2]);
    if (w.valid && w.within(static_cast<float>(MapLayout::kDistanceOne))) {
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

  MapReader reader_;
  bool smooth_normals_;
  float voxels_per_unit_;
  float stride_unknown_;  // voxels; the band across a surface is at least 5 thick
  float reach_;
  Int4 base_{};
  Float4 origin_{};
  Float4 axes_[3]{};  // camera axes in grid units a metre
  float R_[3][3];
  std::int64_t steps_ = 0;
};

}  // namespace perception
