#include "perception/tsdf/blocks/map_view.hpp"

namespace perception {

std::uint32_t MapView::word_at(int i, int j, int k) const noexcept {
  const std::int32_t b = find_block({i >> 3, j >> 3, k >> 3});
  return b == kNoBlock ? 0U : block_words(b)[in_block(i, j, k)];
}

LabelVoxel MapView::label_at(int i, int j, int k) const noexcept {
  const std::int32_t b = find_block({i >> 3, j >> 3, k >> 3});
  const LabelVoxel* labels = b == kNoBlock ? nullptr : block_labels(b);
  return labels == nullptr ? LabelVoxel{} : labels[in_block(i, j, k)];
}

bool MapView::free_at(int i, int j, int k) const noexcept {
  const Chunk* c = find_chunk(i >> 6, j >> 6, k >> 6);
  if (c == nullptr) return false;
  const auto slot = static_cast<std::size_t>(in_chunk(i >> 3, j >> 3, k >> 3));
  const std::int32_t b = c->block[slot];
  if (b == kNoBlock) {
    const int cell = ((((i & 7) >> 1) * 4) + ((j & 7) >> 1)) * 4 + ((k & 7) >> 1);
    return ((c->free[slot] >> cell) & 1U) != 0;
  }
  const std::uint32_t word = block_words(b)[in_block(i, j, k)];
  if (word_weight(word) >= kObservedWeight) return word_distance(word) > 0;
  return ((block_free(b)[i & 7] >> ((j & 7) * 8 + (k & 7))) & 1U) != 0;
}

Seen MapView::seen_at(int i, int j, int k) const noexcept {
  if (word_weight(word_at(i, j, k)) >= kObservedWeight) return Seen::kBand;
  return free_at(i, j, k) ? Seen::kFree : Seen::kUnknown;
}

}  // namespace perception
