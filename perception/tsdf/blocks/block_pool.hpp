// Where blocks and chunks are kept: slots, the index that finds them, the lists of those given
// back.
//
// Memory    everything is allocated and touched in the constructor. A full pool keeps what is
//           stored and refuses new blocks.
// Place     a block keeps its pool index and a chunk its number until it is dropped. Nothing is
//           moved, so pointers into a block or a chunk stay valid until then.
// Thread    one thread changes it at a time; other blocks' voxels may be written by others
//           meanwhile.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/tsdf/blocks/block_past.hpp"
#include "perception/tsdf/blocks/chunk_index.hpp"
#include "perception/tsdf/blocks/map_layout.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class BlockPool : public MapLayout {
 public:
  BlockPool(rt::NonRealtime&, int max_blocks, int max_chunks);

  // --- chunks. Numbers are below chunk_count(); those not in use hold nothing and stand at
  // kNowhere.
  [[nodiscard]] int chunk_count() const noexcept { return chunk_count_; }
  [[nodiscard]] const Chunk& chunk(int n) const noexcept {
    return chunks_[static_cast<std::size_t>(n)];
  }
  [[nodiscard]] Chunk& chunk(int n) noexcept { return chunks_[static_cast<std::size_t>(n)]; }
  [[nodiscard]] std::int32_t chunk_number(int cx, int cy, int cz) const noexcept {
    return index_.find(cx, cy, cz);  // ChunkIndex::kNone when absent
  }
  [[nodiscard]] const Chunk* find_chunk(int cx, int cy, int cz) const noexcept;
  [[nodiscard]] Chunk* find_chunk(int cx, int cy, int cz) noexcept;
  [[nodiscard]] bool has_room(int blocks) const noexcept {  // for a chunk of so many
    return (recycled_chunk_count_ > 0 || chunk_count_ < max_chunks_) && free_blocks() >= blocks;
  }
  Chunk* new_chunk(BlockCoord at) noexcept;       // nullptr: pool full
  void drop_chunk(std::int32_t number) noexcept;  // that holds no block

  // --- blocks, by pool index; live blocks are those with in_use().
  [[nodiscard]] std::int32_t find_block(BlockCoord b) const noexcept;  // kNoBlock when absent
  [[nodiscard]] int slots() const noexcept { return used_blocks_; }    // indices 0..slots-1
  [[nodiscard]] int live() const noexcept { return live_blocks_; }
  [[nodiscard]] int free_blocks() const noexcept {
    return max_blocks_ - used_blocks_ + recycled_count_;
  }
  [[nodiscard]] bool in_use(std::int32_t block) const noexcept {
    return in_use_[static_cast<std::size_t>(block)] != 0;
  }
  [[nodiscard]] BlockCoord coord(std::int32_t block) const noexcept {
    return coords_[static_cast<std::size_t>(block)];
  }
  // 512 words and colours (perception/geometry/no_colour.hpp), 8 words of free bits: bit (y * 8 +
  // z) of word x.
  [[nodiscard]] const std::uint32_t* words(std::int32_t block) const noexcept {
    return words_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  [[nodiscard]] std::uint32_t* words(std::int32_t block) noexcept {
    return words_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  [[nodiscard]] const std::uint32_t* colours(std::int32_t block) const noexcept {
    return colours_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  [[nodiscard]] std::uint32_t* colours(std::int32_t block) noexcept {
    return colours_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  [[nodiscard]] const std::uint64_t* free_bits(std::int32_t block) const noexcept {
    return free_.data() + static_cast<std::size_t>(block) * 8;
  }
  [[nodiscard]] std::uint64_t* free_bits(std::int32_t block) noexcept {
    return free_.data() + static_cast<std::size_t>(block) * 8;
  }
  // Index of the block that words() of it are.
  [[nodiscard]] std::ptrdiff_t number_of(const std::uint32_t* words) const noexcept {
    return (words - words_.data()) / kBlockVoxels;
  }
  [[nodiscard]] BlockPast& past(std::int32_t block) noexcept {
    return pasts_[static_cast<std::size_t>(block)];
  }
  // A block of unknown voxels without history and with undefined free bits; kNoBlock: pool full.
  std::int32_t new_block(Chunk& c, BlockCoord at) noexcept;
  void drop_block(Chunk& c, int slot) noexcept;

  // --- changes. The revision rises with every call that may change blocks.
  [[nodiscard]] std::uint32_t revision() const noexcept { return revision_; }
  void next_revision() noexcept { ++revision_; }
  void mark_changed(std::int32_t block) noexcept {
    changed_[static_cast<std::size_t>(block)] = revision_;
  }
  // Revision of the last call that changed anything that the block's cells read: its own voxels (a
  // decay counts if it makes an observed voxel unknown), the voxels of its upper neighbours in x, y
  // and z, or whether those exist.
  [[nodiscard]] std::uint32_t cells_revision(std::int32_t block) const noexcept {
    std::uint32_t newest = 0;
    const std::int32_t* ahead = ahead_.data() + static_cast<std::size_t>(block) * 8;
    for (int n = 0; n < 8; ++n)
      newest = std::max(newest, changed_[static_cast<std::size_t>(ahead[n])]);
    return newest;
  }

  [[nodiscard]] Arrays arrays() const noexcept;
  void clear() noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  // Block number `block` now stands (kNoBlock: no longer) at `at`: tells those behind it.
  void link(BlockCoord at, std::int32_t block) noexcept;

  int max_blocks_, max_chunks_;
  ChunkIndex index_;
  std::vector<Chunk> chunks_;
  std::vector<std::int32_t> recycled_chunks_;
  int chunk_count_ = 0, recycled_chunk_count_ = 0;
  std::vector<std::uint32_t> words_, colours_;
  std::vector<std::uint64_t> free_;
  std::vector<BlockCoord> coords_;
  std::vector<std::int32_t> ahead_;
  std::vector<std::uint32_t> changed_;  // revision of the last call that did
  std::uint32_t revision_ = 1;
  std::vector<std::uint8_t> in_use_;
  std::vector<std::int32_t> recycled_;  // stack of returned pool indices
  std::vector<BlockPast> pasts_;
  int used_blocks_ = 0, recycled_count_ = 0, live_blocks_ = 0;
};

}  // namespace perception
