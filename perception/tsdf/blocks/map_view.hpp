// Read-only view of a map, for ray cast, mesh, patch, motion, objects and files. No virtual calls;
// what is read in loops is inline.
//
// A view is as large as a pointer and is copied freely. It is valid as long as the map and shows
// the map's present content. Pointers that it returns are valid until the map changes. Frame: nodes
// and boxes in W. Any number of threads may read between two changes.
#pragma once

#include <cstddef>
#include <cstdint>

#include "perception/tsdf/blocks/map_store.hpp"

namespace perception {

class MapView : public MapLayout {
 public:
  explicit MapView(const MapStore& store) noexcept : store_(&store) {}

  [[nodiscard]] const TsdfConfig& config() const noexcept { return store_->config; }
  [[nodiscard]] double voxel_size() const noexcept { return store_->voxel; }
  [[nodiscard]] double truncation() const noexcept { return store_->truncation; }
  [[nodiscard]] float metres_per_unit() const noexcept { return store_->metres_per_unit; }
  [[nodiscard]] std::uint32_t map_id() const noexcept { return store_->map_id; }
  [[nodiscard]] int block_count() const noexcept { return store_->blocks.live(); }
  // Chunk numbers are below it; those not in use hold nothing and stand at no place a camera can
  // be.
  [[nodiscard]] int chunk_count() const noexcept { return store_->blocks.chunk_count(); }

  // --- blocks, by pool index; live blocks are those with in_use().
  [[nodiscard]] std::int32_t find_block(BlockCoord b) const noexcept {  // kNoBlock when absent
    return store_->blocks.find_block(b);
  }
  [[nodiscard]] int block_slots() const noexcept { return store_->blocks.slots(); }
  [[nodiscard]] bool in_use(std::int32_t block) const noexcept {
    return store_->blocks.in_use(block);
  }
  [[nodiscard]] BlockCoord block_coord(std::int32_t block) const noexcept {
    return store_->blocks.coord(block);
  }
  [[nodiscard]] const std::uint32_t* block_words(std::int32_t block) const noexcept {
    return store_->blocks.words(block);
  }
  // Colour, how often read and how often coloured (perception/geometry/no_colour.hpp).
  [[nodiscard]] const std::uint32_t* block_colours(std::int32_t block) const noexcept {
    return store_->blocks.colours(block);
  }
  // 8 words, bit (y * 8 + z) of word x.
  [[nodiscard]] const std::uint64_t* block_free(std::int32_t block) const noexcept {
    return store_->blocks.free_bits(block);
  }
  // fn(pool index, BlockCoord) for every live block, in order of pool index.
  template <class Fn>
  void for_each_block(Fn&& fn) const {
    for (std::int32_t b = 0; b < block_slots(); ++b)
      if (in_use(b)) fn(b, block_coord(b));
  }

  // --- labels
  // 512 of the block; nullptr where nothing is labelled.
  [[nodiscard]] const LabelVoxel* block_labels(std::int32_t block) const noexcept {
    return store_->labels.of(block);
  }
  // Label of one voxel; if its block holds none, the background that the images so far imply.
  [[nodiscard]] LabelVoxel label_in(std::int32_t block, int voxel) const noexcept {
    const LabelVoxel* held = block_labels(block);
    return held != nullptr ? held[voxel] : store_->implied_background(block_words(block)[voxel]);
  }
  // Bit n: label n > 0 occurs in the block.
  [[nodiscard]] std::uint32_t labels_present(std::int32_t block) const noexcept {
    return store_->labels.present(block);
  }
  [[nodiscard]] int label_block_count() const noexcept { return store_->labels.block_count(); }
  // fn(pool index of the block, bits of its labels), in order of the label pool.
  template <class Fn>
  void for_each_label_block(Fn&& fn) const {
    store_->labels.for_each(fn);
  }

  // --- what has changed since when (block_pool.hpp)
  [[nodiscard]] std::uint32_t revision() const noexcept { return store_->blocks.revision(); }
  [[nodiscard]] std::uint32_t cells_revision(std::int32_t block) const noexcept {
    return store_->blocks.cells_revision(block);
  }

  // --- for vector kernels: the arrays themselves (map_layout.hpp)
  [[nodiscard]] Arrays arrays() const noexcept { return store_->blocks.arrays(); }

  // --- chunks
  [[nodiscard]] const Chunk* find_chunk(int cx, int cy, int cz) const noexcept {
    return store_->blocks.find_chunk(cx, cy, cz);
  }
  [[nodiscard]] const Chunk& chunk(int n) const noexcept {  // n < chunk_count(), allocation order
    return store_->blocks.chunk(n);
  }

  // --- single nodes (any world node; slow, see MapReader for runs of reads)
  [[nodiscard]] std::uint32_t word_at(int i, int j, int k) const noexcept;  // 0 when unknown
  // Seen free: an observed voxel by its sign, any other by its bit.
  [[nodiscard]] bool free_at(int i, int j, int k) const noexcept;
  [[nodiscard]] LabelVoxel label_at(int i, int j, int k) const noexcept;
  // kBand: weight >= 2 observations; else free or unknown.
  [[nodiscard]] Seen seen_at(int i, int j, int k) const noexcept;

 private:
  const MapStore* store_;
};

}  // namespace perception
