// Runs of reads from a TsdfMap: remembers the last block, so a neighbouring read costs one compare.
// A reader holds pointers into the map: use it only between two changes of the map.
#pragma once

#include <cmath>
#include <cstdint>

#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/tsdf_map.hpp"

namespace perception {

class MapReader {
 public:
  // min_weight in observations: nodes below count as unknown.
  explicit MapReader(const TsdfMap& map, double min_weight = 1.0) noexcept
      : map_(&map),
        inv_voxel_(1.0 / map.voxel_size()),
        min_raw_(static_cast<std::uint32_t>(std::lround(
                     std::fmin(std::fmax(min_weight * TsdfMap::kWeightOne, 1.0), 65535.0)))
                 << 16U) {}

  // Word of world node (i,j,k); 0 when unknown.
  [[nodiscard]] std::uint32_t word(int i, int j, int k) noexcept {
    const std::uint32_t* block = block_of(i >> 3, j >> 3, k >> 3);
    return block == nullptr ? 0U : block[TsdfMap::in_block(i, j, k)];
  }
  [[nodiscard]] bool known(std::uint32_t word) const noexcept { return word >= min_raw_; }
  // Words of a block, nullptr when it is not allocated.
  [[nodiscard]] const std::uint32_t* block_of(int bx, int by, int bz) noexcept {
    if (bx == bx_ && by == by_ && bz == bz_) return block_;
    return fetch(bx, by, bz);
  }
  [[nodiscard]] const TsdfMap::Chunk* chunk_of(int cx, int cy, int cz) noexcept {
    if (cx != cx_ || cy != cy_ || cz != cz_ || !have_chunk_) {
      chunk_ = map_->find_chunk(cx, cy, cz);
      cx_ = cx, cy_ = cy, cz_ = cz, have_chunk_ = true;
    }
    return chunk_;
  }

  // The eight corners of the cell round a point. Corner c: bit 2 = x+1, bit 1 = y+1, bit 0 = z+1.
  struct Cell {
    float d[8];        // raw units
    float fx, fy, fz;  // position in the cell, [0, 1)
    bool valid;        // all eight known
    [[nodiscard]] float value() const noexcept {  // raw units
      const float a = d[0] + fz * (d[1] - d[0]), b = d[2] + fz * (d[3] - d[2]);
      const float c = d[4] + fz * (d[5] - d[4]), e = d[6] + fz * (d[7] - d[6]);
      const float f = a + fy * (b - a), g = c + fy * (e - c);
      return f + fx * (g - f);
    }
    // Of the interpolant, raw units a voxel.
    void gradient(float (&g)[3]) const noexcept {
      const float z0 = d[0] + fz * (d[1] - d[0]), z1 = d[2] + fz * (d[3] - d[2]);
      const float z2 = d[4] + fz * (d[5] - d[4]), z3 = d[6] + fz * (d[7] - d[6]);
      const float x0 = z0 + fy * (z1 - z0), x1 = z2 + fy * (z3 - z2);
      g[0] = x1 - x0;
      g[1] = (z1 - z0) + fx * ((z3 - z2) - (z1 - z0));
      const float e0 = d[1] - d[0], e1 = d[3] - d[2], e2 = d[5] - d[4], e3 = d[7] - d[6];
      const float y0 = e0 + fy * (e1 - e0), y1 = e2 + fy * (e3 - e2);
      g[2] = y0 + fx * (y1 - y0);
    }
  };
  // Of the point at grid coordinates (x, y, z) = p_W / voxel_size.
  [[nodiscard]] Cell cell(double x, double y, double z) noexcept {
    const int i = ifloor(x), j = ifloor(y), k = ifloor(z);
    Cell c;
    c.fx = static_cast<float>(x - i), c.fy = static_cast<float>(y - j);
    c.fz = static_cast<float>(z - k);
    std::uint32_t least;
    if ((i & 7) != 7 && (j & 7) != 7 && (k & 7) != 7) {
      const std::uint32_t* w = block_of(i >> 3, j >> 3, k >> 3);
      if (w == nullptr) {
        c.valid = false;
        return c;
      }
      w += TsdfMap::in_block(i, j, k);
      least = take(c, 0, w[0], w[0]);
      least = take(c, 1, w[1], least);
      least = take(c, 2, w[8], least);
      least = take(c, 3, w[9], least);
      least = take(c, 4, w[64], least);
      least = take(c, 5, w[65], least);
      least = take(c, 6, w[72], least);
      least = take(c, 7, w[73], least);
    } else {
      least = 0xffffffffU;
      for (int n = 0; n < 8; ++n) {
        least = take(c, n, word(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1)), least);
        if (least < min_raw_) break;
      }
    }
    c.valid = least >= min_raw_;
    return c;
  }

  struct Sample {
    float distance_m = 0;
    bool valid = false;  // all eight corners known
  };
  // Trilinear distance at a world point.
  [[nodiscard]] Sample sample(const Vec3& p_W) noexcept;
  // Central difference of sample() over one voxel either side, m/m; false when any of it is unknown.
  [[nodiscard]] bool gradient(const Vec3& p_W, Vec3& out) noexcept;
  // Colour of the nearest corner of the cell that has one; false when none has.
  [[nodiscard]] bool colour(const Vec3& p_W, Rgb& out) noexcept;

 private:
  static std::uint32_t take(Cell& c, int n, std::uint32_t w, std::uint32_t least) noexcept {
    c.d[n] = static_cast<float>(TsdfMap::word_distance(w));
    return w < least ? w : least;
  }
  const std::uint32_t* fetch(int bx, int by, int bz) noexcept {
    bx_ = bx, by_ = by, bz_ = bz;
    const TsdfMap::Chunk* c = chunk_of(bx >> 3, by >> 3, bz >> 3);
    const std::int32_t b = c == nullptr
                               ? TsdfMap::kNoBlock
                               : c->block[static_cast<std::size_t>(TsdfMap::in_chunk(bx, by, bz))];
    block_ = b == TsdfMap::kNoBlock ? nullptr : map_->block_words(b);
    return block_;
  }

  const TsdfMap* map_;
  double inv_voxel_;
  std::uint32_t min_raw_;
  int bx_ = INT32_MIN, by_ = 0, bz_ = 0, cx_ = 0, cy_ = 0, cz_ = 0;
  const std::uint32_t* block_ = nullptr;
  const TsdfMap::Chunk* chunk_ = nullptr;
  bool have_chunk_ = false;
};

}  // namespace perception
