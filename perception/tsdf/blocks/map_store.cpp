#include "perception/tsdf/blocks/map_store.hpp"

#include <algorithm>

namespace perception {
namespace {

constexpr int kChunkEdgeBlocks = 8;

}  // namespace

void expand_free(std::uint64_t cells, std::uint64_t* bits) noexcept {
  for (int x = 0; x < 8; ++x) {
    std::uint64_t word = 0;
    for (int y = 0; y < 8; ++y)
      for (int z = 0; z < 8; ++z)
        if (((cells >> (((x >> 1) * 4 + (y >> 1)) * 4 + (z >> 1))) & 1U) != 0)
          word |= 1ULL << (y * 8 + z);
    bits[x] = word;
  }
}

std::uint64_t shrink_free(const std::uint64_t* bits) noexcept {
  std::uint64_t cells = 0;
  for (int cell = 0; cell < 64; ++cell) {
    const int x = (cell >> 4) * 2, y = ((cell >> 2) & 3) * 2, z = (cell & 3) * 2;
    const std::uint64_t both = bits[x] & bits[x + 1];
    const std::uint64_t pair = (3ULL << (y * 8 + z)) | (3ULL << (y * 8 + 8 + z));
    if ((both & pair) == pair) cells |= 1ULL << cell;
  }
  return cells;
}

MapStore::MapStore(rt::NonRealtime& nrt, const TsdfConfig& c)
    : config(checked(c)),
      voxel(config.voxel_size_m),
      truncation(config.effective_truncation()),
      metres_per_unit(static_cast<float>(truncation / kDistanceOne)),
      blocks(nrt, config.max_blocks, config.max_chunks),
      labels(nrt, config.max_blocks, config.max_label_blocks) {}

void MapStore::clear() noexcept {
  blocks.next_revision();
  labels.clear(blocks.slots());
  blocks.clear();
  ++map_id;
}

void MapStore::drop_block(Chunk& c, int slot) noexcept {
  const std::int32_t b = c.block[static_cast<std::size_t>(slot)];
  blocks.drop_block(c, slot);
  labels.release(b);
}

void MapStore::free_block(Chunk& c, int slot) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  c.free[s] = shrink_free(blocks.free_bits(c.block[s]));
  if (c.free[s] != ~0ULL) c.settled[s >> 6U] &= ~(1ULL << (s & 63U));
  drop_block(c, slot);
}

void MapStore::clear_in_block(Chunk& c, int slot, const std::array<int, 3>& lo,
                              const std::array<int, 3>& hi) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  const std::int32_t b = c.block[s];
  std::array<std::uint64_t, 8> bits{};
  std::uint64_t* free = b == kNoBlock ? bits.data() : blocks.free_bits(b);
  if (b == kNoBlock) expand_free(c.free[s], free);
  if (b != kNoBlock) blocks.mark_changed(b);
  LabelVoxel* held = b == kNoBlock ? nullptr : labels.of(b);
  for (int x = lo[0]; x <= hi[0]; ++x)
    for (int y = lo[1]; y <= hi[1]; ++y)
      for (int z = lo[2]; z <= hi[2]; ++z) {
        free[x] &= ~(1ULL << (y * 8 + z));
        if (b == kNoBlock) continue;
        const int n = in_block(x, y, z);
        blocks.words(b)[n] = blocks.colours(b)[n] = 0;
        if (held != nullptr) held[n] = {};
      }
  if (b == kNoBlock) {
    c.free[s] = shrink_free(free);
    if (c.free[s] != ~0ULL) c.settled[s >> 6U] &= ~(1ULL << (s & 63U));
  } else if (std::all_of(blocks.words(b), blocks.words(b) + kBlockVoxels,
                         [](std::uint32_t w) { return word_weight(w) == 0; })) {
    free_block(c, slot);
  } else if (held != nullptr) {
    static_cast<void>(labels.store(b, {held, kBlockVoxels}));  // what is left of them
  }
}

void MapStore::clear_nodes(const std::array<int, 3>& lo, const std::array<int, 3>& hi) noexcept {
  for (int n = 0; n < blocks.chunk_count(); ++n) {
    Chunk& c = blocks.chunk(n);
    if (c.coord == kNowhere) continue;
    const std::array<int, 3> base{c.coord.x * 64, c.coord.y * 64, c.coord.z * 64};
    bool apart = false;
    for (std::size_t a = 0; a < 3; ++a) apart |= base[a] > hi[a] || base[a] + 63 < lo[a];
    if (apart) continue;
    for (int slot = 0; slot < kChunkBlocks; ++slot) {
      const std::array<int, 3> node{base[0] + (slot >> 6) * kChunkEdgeBlocks,
                                    base[1] + ((slot >> 3) & 7) * kChunkEdgeBlocks,
                                    base[2] + (slot & 7) * kChunkEdgeBlocks};
      std::array<int, 3> from{}, to{};
      bool touched = true;
      for (std::size_t a = 0; a < 3; ++a) {
        from[a] = std::max(lo[a] - node[a], 0);
        to[a] = std::min(hi[a] - node[a], 7);
        touched &= from[a] <= to[a];
      }
      if (touched && (c.block[static_cast<std::size_t>(slot)] != kNoBlock ||
                      c.free[static_cast<std::size_t>(slot)] != 0))
        clear_in_block(c, slot, from, to);
    }
  }
}

void MapStore::add_to(rt::Hash64& h) const noexcept {
  for (int n = 0; n < blocks.chunk_count(); ++n) {
    const Chunk& c = blocks.chunk(n);
    h.value(c.coord);
    h.bytes(c.block.data(), sizeof c.block);
    h.bytes(c.free.data(), sizeof c.free);
  }
  for (std::int32_t b = 0; b < blocks.slots(); ++b) {
    if (!blocks.in_use(b)) continue;
    h.bytes(blocks.words(b), kBlockVoxels * sizeof(std::uint32_t));
    h.bytes(blocks.colours(b), kBlockVoxels * sizeof(std::uint32_t));
    if (labels.of(b) != nullptr) h.bytes(labels.of(b), kBlockVoxels * sizeof(LabelVoxel));
    h.bytes(blocks.free_bits(b), 8 * sizeof(std::uint64_t));
  }
}

}  // namespace perception
