#include "perception/tsdf/blocks/block_pool.hpp"

#include "perception/tsdf/blocks/held_bytes.hpp"

namespace perception {

BlockPool::BlockPool(rt::NonRealtime& nrt, int max_blocks, int max_chunks)
    : max_blocks_(max_blocks),
      max_chunks_(max_chunks),
      index_(nrt, static_cast<std::size_t>(max_chunks)) {
  const auto blocks = static_cast<std::size_t>(max_blocks);
  const auto chunks = static_cast<std::size_t>(max_chunks);
  chunks_.resize(chunks + 1);
  recycled_chunks_.assign(chunks, 0);
  chunks_.back().block.fill(kNoBlock);
  words_.assign((blocks + 1) * kBlockVoxels + MapLayout::kWordsBehind, 0);
  colours_.assign(blocks * kBlockVoxels, 0);
  free_.assign(blocks * 8, 0);
  coords_.assign(blocks, {});
  ahead_.assign((blocks + 1) * 8, max_blocks);
  changed_.assign(blocks + 1, 0);
  in_use_.assign(blocks, 0);
  recycled_.assign(blocks, 0);
  pasts_.assign(blocks, {});
}

std::size_t BlockPool::memory_bytes() const noexcept {
  return index_.memory_bytes() + held_bytes(chunks_, recycled_chunks_, words_, colours_, free_,
                                            coords_, ahead_, changed_, in_use_, recycled_, pasts_);
}

void BlockPool::clear() noexcept {
  index_.clear();
  std::fill_n(in_use_.begin(), used_blocks_, std::uint8_t{0});
  chunk_count_ = recycled_chunk_count_ = used_blocks_ = recycled_count_ = live_blocks_ = 0;
}

const BlockPool::Chunk* BlockPool::find_chunk(int cx, int cy, int cz) const noexcept {
  const std::int32_t n = index_.find(cx, cy, cz);
  return n == ChunkIndex::kNone ? nullptr : &chunks_[static_cast<std::size_t>(n)];
}

BlockPool::Chunk* BlockPool::find_chunk(int cx, int cy, int cz) noexcept {
  const std::int32_t n = index_.find(cx, cy, cz);
  return n == ChunkIndex::kNone ? nullptr : &chunks_[static_cast<std::size_t>(n)];
}

BlockPool::Chunk* BlockPool::new_chunk(BlockCoord at) noexcept {
  std::int32_t n;
  if (recycled_chunk_count_ > 0) {
    n = recycled_chunks_[static_cast<std::size_t>(--recycled_chunk_count_)];
  } else if (chunk_count_ < max_chunks_) {
    n = chunk_count_++;
  } else {
    return nullptr;
  }
  index_.insert(at.x, at.y, at.z, n);
  Chunk& c = chunks_[static_cast<std::size_t>(n)];
  c.block.fill(kNoBlock);
  c.free.fill(0);
  c.settled.fill(0);
  c.coord = at;
  c.blocks = 0;
  c.carved = 0;
  return &c;
}

void BlockPool::drop_chunk(std::int32_t number) noexcept {
  Chunk& c = chunks_[static_cast<std::size_t>(number)];
  index_.erase(c.coord.x, c.coord.y, c.coord.z);
  c.free.fill(0);
  c.settled.fill(0);
  c.coord = kNowhere;
  recycled_chunks_[static_cast<std::size_t>(recycled_chunk_count_++)] = number;
}

std::int32_t BlockPool::new_block(Chunk& c, BlockCoord at) noexcept {
  std::int32_t b;
  if (recycled_count_ > 0) {
    b = recycled_[static_cast<std::size_t>(--recycled_count_)];
  } else if (used_blocks_ < max_blocks_) {
    b = used_blocks_++;
  } else {
    return kNoBlock;
  }
  std::fill_n(words(b), kBlockVoxels, 0U);
  std::fill_n(colours(b), kBlockVoxels, 0U);
  coords_[static_cast<std::size_t>(b)] = at;
  in_use_[static_cast<std::size_t>(b)] = 1;
  changed_[static_cast<std::size_t>(b)] = revision_;
  pasts_[static_cast<std::size_t>(b)] = {};
  c.block[static_cast<std::size_t>(in_chunk(at.x, at.y, at.z))] = b;
  c.settled[static_cast<std::size_t>(at.x & 7)] |= 1ULL << ((at.y & 7) * 8 + (at.z & 7));
  ++c.blocks;
  ++live_blocks_;
  link(at, b);
  return b;
}

void BlockPool::drop_block(Chunk& c, int slot) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  const std::int32_t b = c.block[s];
  c.block[s] = kNoBlock;
  link(coords_[static_cast<std::size_t>(b)], kNoBlock);
  --c.blocks;
  --live_blocks_;
  in_use_[static_cast<std::size_t>(b)] = 0;
  recycled_[static_cast<std::size_t>(recycled_count_++)] = b;
}

void BlockPool::link(BlockCoord at, std::int32_t block) noexcept {
  const std::int32_t none = max_blocks_;
  for (std::int32_t n = 0; n < 8; ++n) {
    const int x = n >> 2, y = (n >> 1) & 1, z = n & 1;
    if (block != kNoBlock) {
      const std::int32_t next = n == 0 ? block : find_block({at.x + x, at.y + y, at.z + z});
      ahead_[static_cast<std::size_t>(8 * block + n)] = next == kNoBlock ? none : next;
    }
    if (n == 0) continue;
    const std::int32_t behind = find_block({at.x - x, at.y - y, at.z - z});
    if (behind == kNoBlock) continue;
    ahead_[static_cast<std::size_t>(8 * behind + n)] = block == kNoBlock ? none : block;
    changed_[static_cast<std::size_t>(behind)] = revision_;
  }
}

std::int32_t BlockPool::find_block(BlockCoord b) const noexcept {
  const Chunk* c = find_chunk(b.x >> 3, b.y >> 3, b.z >> 3);
  return c == nullptr ? kNoBlock : c->block[static_cast<std::size_t>(in_chunk(b.x, b.y, b.z))];
}

BlockPool::Arrays BlockPool::arrays() const noexcept {
  static_assert(sizeof(Chunk) % sizeof(std::int32_t) == 0);
  constexpr auto kStride = static_cast<std::int32_t>(sizeof(Chunk) / sizeof(std::int32_t));
  return {chunks_.front().block.data(),
          reinterpret_cast<const std::int32_t*>(words_.data()),
          ahead_.data(),
          kStride,
          max_chunks_ * kStride,
          max_blocks_};
}

}  // namespace perception
