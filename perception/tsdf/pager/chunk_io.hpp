// Writes a chunk of the pools as a record (chunk_record.hpp), and reads it back.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/pager/chunk_record.hpp"
#include "perception/tsdf/pager/page_stats.hpp"

namespace perception {

// False: the sink had no room.
template <class Sink>
bool write_chunk(const MapStore& store, const MapLayout::Chunk& c, std::uint32_t carved,
                 Sink& sink) noexcept {
  const BlockPool& blocks = store.blocks;
  ChunkHead head{c.coord.x, c.coord.y, c.coord.z, carved, static_cast<std::uint16_t>(c.blocks),
                 0,         0};
  for (const std::int32_t b : c.block) {
    if (b == MapLayout::kNoBlock || store.labels.of(b) == nullptr) continue;
    ++head.label_blocks;
    head.labels |= store.labels.present(b);
  }
  if (!sink(bytes_of(head)) || !write_cells(c.free, sink)) return false;
  constexpr std::size_t kVoxels = MapLayout::kBlockVoxels;
  std::array<std::uint8_t, kMostBlockBytes> body;
  for (std::uint16_t slot = 0; slot < MapLayout::kChunkBlocks; ++slot) {
    const std::int32_t b = c.block[slot];
    if (b == MapLayout::kNoBlock) continue;
    const LabelVoxel* labels = store.labels.of(b);
    const auto bytes = static_cast<std::uint16_t>(
        encode_block(std::span<const std::uint32_t, kVoxels>(blocks.words(b), kVoxels),
                     std::span<const std::uint32_t, kVoxels>(blocks.colours(b), kVoxels),
                     std::span<const std::uint64_t, 8>(blocks.free_bits(b), 8),
                     {labels, labels == nullptr ? 0U : kVoxels}, body));
    if (!sink(bytes_of(slot)) || !sink(bytes_of(bytes)) || !sink({body.data(), bytes}))
      return false;
  }
  return true;
}

// Of a record that the pools have room for. labels: those that were not forgotten since. image:
// room for one block.
template <class Source>
void restore_chunk(MapStore& store, Source& source, std::uint32_t labels, BlockImage& image,
                   PageStats& stats) noexcept {
  ChunkHead head;
  if (!source.read(bytes_into(head))) return;
  MapLayout::Chunk& c = *store.blocks.new_chunk({head.x, head.y, head.z});
  c.carved = head.carved;
  if (!read_cells(source, c.free)) return;
  for (std::size_t i = 0; i < c.free.size(); ++i)
    c.settled[i >> 6U] |= std::uint64_t{c.free[i] == ~0ULL} << (i & 63U);
  for (int n = 0; n < head.blocks; ++n) {
    std::uint16_t slot = 0;
    if (!read_block(source, slot, image)) return;
    const std::int32_t b = store.blocks.new_block(
        c, {head.x * 8 + (slot >> 6), head.y * 8 + ((slot >> 3) & 7), head.z * 8 + (slot & 7)});
    std::copy(image.words.begin(), image.words.end(), store.blocks.words(b));
    std::copy(image.colours.begin(), image.colours.end(), store.blocks.colours(b));
    std::copy(image.free.begin(), image.free.end(), store.blocks.free_bits(b));
    ++stats.blocks_moved;
    if (!image.labelled) continue;
    for (LabelVoxel& v : image.labels)
      if (v.label != 0 && ((labels >> v.label) & 1U) == 0) v = {};
    if (!store.labels.store(b, image.labels)) ++stats.labels_refused;
  }
}

}  // namespace perception
