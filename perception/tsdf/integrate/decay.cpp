// What is not seen again is forgotten in the end: weights fall by half in decay_half_life_s. A part of the
// pool a call, so that every frame pays the same.
#include <algorithm>
#include <cmath>

#include "perception/tsdf/tsdf_map.hpp"

namespace perception {
namespace {

constexpr std::uint32_t kForgotten = TsdfMap::kWeightOne / 4;  // the least that one reading gives

}  // namespace

void TsdfMap::decay(double dt_s) noexcept {
  if (!(config_.decay_half_life_s > 0) || !(dt_s > 0)) return;
  ++revision_;
  const double round_s = dt_s * kDecayRound;
  // In 1/65536, rounded down: a weight that is not renewed never stands still.
  const auto keep = static_cast<std::uint32_t>(
      65536.0 * std::exp2(-std::min(round_s / config_.decay_half_life_s, 64.0)));
  const auto part = [&](int n) {
    return static_cast<std::int32_t>(std::int64_t{used_blocks_} * n / kDecayRound);
  };
  const std::int32_t first = part(decay_at_), last = part(decay_at_ + 1);
  decay_at_ = (decay_at_ + 1) % kDecayRound;
  for (std::int32_t b = first; b < last; ++b) {
    if (!in_use(b) || decay_block(b, keep)) continue;
    const BlockCoord at = coords_[static_cast<std::size_t>(b)];
    Chunk* c = const_cast<Chunk*>(find_chunk(at.x >> 3, at.y >> 3, at.z >> 3));
    free_block(*c, in_chunk(at.x, at.y, at.z));
    in_view_count_ = 0;  // blocks went
  }
}

// False: nothing is left of it.
bool TsdfMap::decay_block(std::int32_t block, std::uint32_t keep) noexcept {
  const auto base = static_cast<std::size_t>(block) * kBlockVoxels;
  std::uint32_t* words = words_.data() + base;
  std::uint32_t* colours = colours_.data() + base;
  std::uint32_t left = 0, gone = 0;
  bool hidden = false;  // something observed is no longer
  for (int i = 0; i < kBlockVoxels; ++i) {
    const std::uint32_t before = words[i] >> 16U;
    const std::uint32_t weight = (before * keep) >> 16U;
    const bool known = weight >= kForgotten;
    words[i] = known ? (words[i] & 0xffffU) | weight << 16U : 0U;
    colours[i] = known ? colours[i] : 0U;
    hidden |= before >= kObservedWeight && weight < kObservedWeight;
    left |= words[i];
    gone |= known ? 0U : before;
  }
  if (hidden) changed_[static_cast<std::size_t>(block)] = revision_;
  if (left == 0) return false;
  if (gone != 0 && block_labels(block) != nullptr) {
    auto* labels = const_cast<LabelVoxel*>(block_labels(block));
    for (int i = 0; i < kBlockVoxels; ++i)
      if (words[i] == 0) labels[i] = {};
    static_cast<void>(store_labels(block, {labels, kBlockVoxels}));
  }
  return true;
}

}  // namespace perception
