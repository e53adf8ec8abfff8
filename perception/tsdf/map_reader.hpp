// Runs of reads from a TsdfMap: remembers the last block, so a neighbouring read costs one compare.
// A reader holds pointers into the map: use it only between two changes of the map.
#pragma once

#include <cmath>

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

  // The eight corners of the cell round g (grid units). Corner c: bit 2 = x+1, bit 1 = y+1, bit 0 = z+1.
  struct Cell {
    float d[8];       // raw units
    float fx, fy, fz; // position in the cell, [0, 1)
    bool valid;       // all eight known
    [[nodiscard]] float value() const noexcept;             // raw units
    [[nodiscard]] Eigen::Vector3f gradient() const noexcept;  // raw units a voxel, of the interpolant
  };
  [[nodiscard]] Cell cell(const Vec3& grid) noexcept;

  struct Sample {
    float distance_m = 0;
    bool valid = false;  // all eight corners known
  };
  // Trilinear distance at a world point.
  [[nodiscard]] Sample sample(const Vec3& p_W) noexcept;
  // Central difference of sample() over one voxel either side, m/m; false when any of it is unknown.
  [[nodiscard]] bool gradient(const Vec3& p_W, Vec3& out) noexcept;
  // Colour of the nearest node that has one among the cell's corners; false when none has.
  [[nodiscard]] bool colour(const Vec3& p_W, Rgb& out) noexcept;

 private:
  const std::uint32_t* fetch(int bx, int by, int bz) noexcept;

  const TsdfMap* map_;
  double inv_voxel_;
  std::uint32_t min_raw_;
  int bx_ = INT32_MIN, by_ = 0, bz_ = 0, cx_ = 0, cy_ = 0, cz_ = 0;
  const std::uint32_t* block_ = nullptr;
  const TsdfMap::Chunk* chunk_ = nullptr;
  bool have_chunk_ = false;
};

}  // namespace perception
