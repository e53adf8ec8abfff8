#include "perception/tsdf/integrate/decay.hpp"

#include <algorithm>
#include <cmath>

namespace perception {
namespace {

constexpr std::uint32_t kForgotten = MapLayout::kWeightOne / 4;  // the least that one reading gives

}  // namespace

void WeightDecay::step(double dt_s) noexcept {
  const double half_life_s = store_.config.decay_half_life_s;
  BlockPool& blocks = store_.blocks;
  if (!(half_life_s > 0) || !(dt_s > 0)) return;
  blocks.next_revision();
  const double round_s = dt_s * kRound;
  // In 1/65536, rounded down: a weight that is not renewed never stands still.
  const auto keep =
      static_cast<std::uint32_t>(65536.0 * std::exp2(-std::min(round_s / half_life_s, 64.0)));
  const auto part = [&](int n) {
    return static_cast<std::int32_t>(std::int64_t{blocks.slots()} * n / kRound);
  };
  const std::int32_t first = part(at_), last = part(at_ + 1);
  at_ = (at_ + 1) % kRound;
  for (std::int32_t b = first; b < last; ++b) {
    if (!blocks.in_use(b) || decay_block(b, keep)) continue;
    const BlockCoord at = blocks.coord(b);
    MapLayout::Chunk* c = blocks.find_chunk(at.x >> 3, at.y >> 3, at.z >> 3);
    store_.free_block(*c, MapLayout::in_chunk(at.x, at.y, at.z));
    viewed_.forget();  // blocks went
  }
}

bool WeightDecay::decay_block(std::int32_t block, std::uint32_t keep) noexcept {
  std::uint32_t* words = store_.blocks.words(block);
  std::uint32_t* colours = store_.blocks.colours(block);
  std::uint32_t left = 0, gone = 0;
  bool hidden = false;  // something observed is no longer
  for (int i = 0; i < MapLayout::kBlockVoxels; ++i) {
    const std::uint32_t before = words[i] >> 16U;
    const std::uint32_t weight = (before * keep) >> 16U;
    const bool known = weight >= kForgotten;
    words[i] = known ? (words[i] & 0xffffU) | weight << 16U : 0U;
    colours[i] = known ? colours[i] : 0U;
    hidden |= before >= MapLayout::kObservedWeight && weight < MapLayout::kObservedWeight;
    left |= words[i];
    gone |= known ? 0U : before;
  }
  if (hidden) store_.blocks.mark_changed(block);
  if (left == 0) return false;
  LabelVoxel* labels = store_.labels.of(block);
  if (gone != 0 && labels != nullptr) {
    for (int i = 0; i < MapLayout::kBlockVoxels; ++i)
      if (words[i] == 0) labels[i] = {};
    static_cast<void>(store_.labels.store(block, {labels, MapLayout::kBlockVoxels}));
  }
  return true;
}

}  // namespace perception
