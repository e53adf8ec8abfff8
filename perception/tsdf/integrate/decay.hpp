// Decay: weights fall by half in decay_half_life_s, so what is not seen again is forgotten. Each
// call treats one part of the pool, so that every frame costs the same. A voxel below a quarter
// observation becomes unknown. Blocks that the pager has compressed keep their weight.
#pragma once

#include <cstdint>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/blocks/viewed_blocks.hpp"

namespace perception {

class WeightDecay {
 public:
  static constexpr int kRound = 32;  // parts, one a call
  // Both belong to the map and must outlive this object.
  WeightDecay(MapStore& store, ViewedBlocks& viewed) noexcept : store_(store), viewed_(viewed) {}

  // Once a frame, dt_s after the one before, by the map's writer.
  void step(double dt_s) noexcept;
  void clear() noexcept { at_ = 0; }

 private:
  // False: the block is empty now. keep: share of a weight that stays, in 1/65536.
  bool decay_block(std::int32_t block, std::uint32_t keep) noexcept;

  MapStore& store_;
  ViewedBlocks& viewed_;
  int at_ = 0;  // the next part
};

}  // namespace perception
