// Reads many nodes of a map. It caches the last blocks and chunks, so a read near the previous one
// costs one comparison. It holds pointers into the map: use it only between two changes of the map.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "perception/geometry/ifloor.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/simd/lanes.hpp"
#include "perception/tsdf/blocks/map_view.hpp"

namespace perception {

class MapReader {
 public:
  // min_weight in observations: nodes below it count as unknown.
  explicit MapReader(const MapView& map, double min_weight = 1.0) noexcept
      : map_(map),
        inv_voxel_(1.0 / map.voxel_size()),
        min_raw_(static_cast<std::int32_t>(
            std::lround(std::fmin(std::fmax(min_weight * MapLayout::kWeightOne, 1.0), 65535.0)))) {}

  // Word of world node (i,j,k); 0 when unknown.
  [[nodiscard]] std::uint32_t word(int i, int j, int k) noexcept {
    const std::uint32_t* block = block_of(i >> 3, j >> 3, k >> 3);
    return block == nullptr ? 0U : block[MapLayout::in_block(i, j, k)];
  }
  [[nodiscard]] bool known(std::uint32_t word) const noexcept {
    return static_cast<std::int32_t>(word >> 16U) >= min_raw_;
  }
  // Raw weight from which a node is known.
  [[nodiscard]] std::int32_t least_weight() const noexcept { return min_raw_; }
  // Words of a block, nullptr when it is not allocated.
  [[nodiscard]] const std::uint32_t* block_of(int bx, int by, int bz) noexcept {
    BlockEntry& e = blocks_[static_cast<std::size_t>((bx & 1) << 2 | (by & 1) << 1 | (bz & 1))];
    if (((e.x ^ bx) | (e.y ^ by) | (e.z ^ bz)) != 0) fetch(e, bx, by, bz);
    return e.words;
  }
  // nullptr when absent.
  [[nodiscard]] const MapLayout::Chunk* chunk_of(int cx, int cy, int cz) noexcept {
    ChunkEntry& e = chunks_[static_cast<std::size_t>((cx & 3) << 4 | (cy & 3) << 2 | (cz & 3))];
    if (((e.x ^ cx) | (e.y ^ cy) | (e.z ^ cz)) != 0) e = {cx, cy, cz, map_.find_chunk(cx, cy, cz)};
    return e.chunk;
  }

  // The eight corners of the cell round a point. Lane n of `low`: x, y + (n >> 1), z + (n & 1); of
  // `high` the same with x + 1.
  struct Cell {
    Float4 low, high;  // raw units
    float fx, fy, fz;  // position in the cell, [0, 1)
    bool valid;        // all eight known; otherwise the values are void

    // Corner n: bit 2 = x+1, bit 1 = y+1, bit 0 = z+1.
    [[nodiscard]] float corner(int n) const noexcept { return n < 4 ? low[n] : high[n - 4]; }
    // Every corner is below `limit` in magnitude.
    [[nodiscard]] bool within(float limit) const noexcept {
      const Float4 l = splat(limit);
      return all_equal((low < l) & (low > -l) & (high < l) & (high > -l), Int4{-1, -1, -1, -1});
    }
    [[nodiscard]] float value() const noexcept {  // raw units
      const Float4 x = low + splat(fx) * (high - low);
      const float z0 = x[0] + fy * (x[2] - x[0]), z1 = x[1] + fy * (x[3] - x[1]);
      return z0 + fz * (z1 - z0);
    }
    // Of the interpolant, raw units a voxel.
    void gradient(float (&g)[3]) const noexcept {
      const Float4 dx = high - low, x = low + splat(fx) * dx;
      const float dx0 = dx[0] + fz * (dx[1] - dx[0]), dx1 = dx[2] + fz * (dx[3] - dx[2]);
      g[0] = dx0 + fy * (dx1 - dx0);
      const float y0 = x[0] + fz * (x[1] - x[0]), y1 = x[2] + fz * (x[3] - x[2]);
      g[1] = y1 - y0;
      const float z0 = x[1] - x[0], z1 = x[3] - x[2];
      g[2] = z0 + fy * (z1 - z0);
    }
  };
  // Of the point at grid coordinates (x, y, z) = p_W / voxel_size.
  [[nodiscard]] Cell cell(double x, double y, double z) noexcept {
    const int i = ifloor(x), j = ifloor(y), k = ifloor(z);
    return cell(i, j, k, static_cast<float>(x - i), static_cast<float>(y - j),
                static_cast<float>(z - k));
  }
  [[nodiscard]] Cell cell(int i, int j, int k, float fx, float fy, float fz) noexcept {
    if ((i & 7) == 7 || (j & 7) == 7 || (k & 7) == 7) return span_cell<1>(i, j, k, fx, fy, fz);
    const std::uint32_t* p = block_of(i >> 3, j >> 3, k >> 3);
    if (p == nullptr) return {Float4{}, Float4{}, fx, fy, fz, false};
    const auto* w = reinterpret_cast<const std::int32_t*>(p) + MapLayout::in_block(i, j, k);
    return decode(Int4{w[0], w[1], w[8], w[9]}, Int4{w[64], w[65], w[72], w[73]}, fx, fy, fz);
  }
  // The same with corners one node farther out, (i - 1 or i + 2, ...): a cell three voxels wide.
  // Positions and gradient are in units of that cell.
  [[nodiscard]] Cell wide_cell(int i, int j, int k, float fx, float fy, float fz) noexcept {
    return span_cell<3>(i - 1, j - 1, k - 1, fx, fy, fz);
  }

  struct Sample {
    float distance_m = 0;
    bool valid = false;  // all eight corners known
  };
  // Trilinear distance at a world point.
  [[nodiscard]] Sample sample(const Vec3& p_W) noexcept;
  // Central difference of sample() over one voxel either side, m/m; false when any of it is
  // unknown.
  [[nodiscard]] bool gradient(const Vec3& p_W, Vec3& out) noexcept;
  // Colour of the nearest corner of the cell that has one; false when none has.
  [[nodiscard]] bool colour(const Vec3& p_W, Rgb& out) noexcept;
  // Label by vote of the eight nodes round the point, each with its label's weight times its
  // trilinear share. Nodes without a vote abstain, so that space between labelled and free nodes
  // keeps the label. If all abstain, as beside an outline, the nearest vote round them counts. 0:
  // background or unknown.
  [[nodiscard]] std::uint8_t label(const Vec3& p_W) noexcept { return voted(p_W).label; }
  // The same with the weight of what won, rounded up (1: of a vote beside); weight 0: nothing
  // known.
  [[nodiscard]] LabelVoxel voted(const Vec3& p_W) noexcept;

 private:
  [[nodiscard]] std::int32_t block_number(int x, int y, int z) noexcept;  // of the node's block
  [[nodiscard]] LabelVoxel nearest_vote(int i, int j, int k, const Vec3f& in_cell) noexcept;
  // Direct-mapped by the low bits, so the eight blocks round a node never collide.
  struct BlockEntry {
    int x = INT32_MIN, y = 0, z = 0;
    const std::uint32_t* words = nullptr;
  };
  struct ChunkEntry {
    int x = INT32_MIN, y = 0, z = 0;
    const MapLayout::Chunk* chunk = nullptr;
  };
  // A cell of any width below a block: asks for each block it reaches into once.
  template <int kSpan>
  [[nodiscard]] Cell span_cell(int i, int j, int k, float fx, float fy, float fz) noexcept {
    const int x0 = i >> 3, y0 = j >> 3, z0 = k >> 3;
    const int x1 = (i + kSpan) >> 3, y1 = (j + kSpan) >> 3, z1 = (k + kSpan) >> 3;
    const auto get = [&](int x, int y, int z) {
      const std::uint32_t* p = block_of(x, y, z);
      return reinterpret_cast<const std::int32_t*>(p == nullptr ? kNothing.data() : p);
    };
    const std::int32_t* p[8];
    p[0] = get(x0, y0, z0);
    p[1] = z1 == z0 ? p[0] : get(x0, y0, z1);
    p[2] = p[0], p[3] = p[1];
    if (y1 != y0) p[2] = get(x0, y1, z0), p[3] = z1 == z0 ? p[2] : get(x0, y1, z1);
    p[4] = p[0], p[5] = p[1], p[6] = p[2], p[7] = p[3];
    if (x1 != x0) {
      p[4] = get(x1, y0, z0);
      p[5] = z1 == z0 ? p[4] : get(x1, y0, z1);
      p[6] = p[4], p[7] = p[5];
      if (y1 != y0) p[6] = get(x1, y1, z0), p[7] = z1 == z0 ? p[6] : get(x1, y1, z1);
    }
    const int xa = (i & 7) << 6, xb = ((i + kSpan) & 7) << 6;
    const int ya = (j & 7) << 3, yb = ((j + kSpan) & 7) << 3;
    const int za = k & 7, zb = (k + kSpan) & 7;
    return decode(
        Int4{p[0][xa + ya + za], p[1][xa + ya + zb], p[2][xa + yb + za], p[3][xa + yb + zb]},
        Int4{p[4][xb + ya + za], p[5][xb + ya + zb], p[6][xb + yb + za], p[7][xb + yb + zb]}, fx,
        fy, fz);
  }
  [[nodiscard]] Cell decode(Int4 low, Int4 high, float fx, float fy, float fz) const noexcept {
    // Weights are 16 bits, so shifted down arithmetically and masked they compare as signed.
    const Int4 least = Int4{min_raw_, min_raw_, min_raw_, min_raw_};
    const Int4 poor = (((low >> 16) & 0xffff) < least) | (((high >> 16) & 0xffff) < least);
    return {to_float((low << 16) >> 16),      to_float((high << 16) >> 16), fx, fy, fz,
            all_equal(poor, Int4{0, 0, 0, 0})};
  }
  void fetch(BlockEntry& e, int bx, int by, int bz) noexcept {
    const MapLayout::Chunk* c = chunk_of(bx >> 3, by >> 3, bz >> 3);
    const std::int32_t b =
        c == nullptr ? MapLayout::kNoBlock
                     : c->block[static_cast<std::size_t>(MapLayout::in_chunk(bx, by, bz))];
    e = {bx, by, bz, b == MapLayout::kNoBlock ? nullptr : map_.block_words(b)};
  }

  static constexpr std::array<std::uint32_t, MapLayout::kBlockVoxels>
      kNothing{};  // an absent block

  MapView map_;
  double inv_voxel_;
  std::int32_t min_raw_;
  std::array<BlockEntry, 8> blocks_;
  std::array<ChunkEntry, 64> chunks_;
};

}  // namespace perception
