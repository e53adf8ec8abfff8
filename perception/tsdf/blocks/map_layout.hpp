// How a map is laid out: sizes, units and the bits of a word. No state.
//
// Grid      node (i,j,k) sits at p_W = (i,j,k) * voxel_size. 8^3 nodes make a block, 8^3 blocks a
//           chunk. Chunks are found through an open-addressing hash, blocks through the chunk's
//           table.
// Voxel     one aligned 32-bit word: int16 distance (unit: truncation / 32767, positive outside)
//           and uint16 weight (unit: 1/128 of one full observation). Weight 0 = unknown, distance
//           void. Beside it, same index: colour (r, g, b), how often read, how often coloured.
#pragma once

#include <array>
#include <cstdint>

namespace perception {

struct BlockCoord {
  std::int32_t x = 0, y = 0, z = 0;  // block (x,y,z) holds nodes 8x..8x+7, ...
  friend bool operator==(const BlockCoord&, const BlockCoord&) = default;
};

enum class Seen : std::uint8_t { kUnknown = 0, kFree = 1, kBand = 2 };

// Base of what stores or reads a map, so that its names are at hand there: TsdfMap::kNoBlock.
struct MapLayout {
  static constexpr int kBlockShift = 3, kBlockEdge = 8, kBlockVoxels = 512;
  static constexpr int kChunkShift = 6;       // of nodes: 64 along an edge
  static constexpr int kChunkBlocks = 512;    // 8^3
  static constexpr int kWeightOne = 128;      // raw weight of one full observation
  static constexpr int kDistanceOne = 32767;  // raw distance of one truncation
  static constexpr std::int32_t kNoBlock = -1;
  static constexpr std::int32_t kMaxBlockCoord = 1 << 19;  // |coordinate| beyond is refused

  static constexpr int kObservedWeight = 2 * kWeightOne;  // "observed": two full observations

  // --- word layout
  [[nodiscard]] static constexpr std::int16_t word_distance(std::uint32_t w) noexcept {
    return static_cast<std::int16_t>(w & 0xffffU);
  }
  [[nodiscard]] static constexpr std::uint16_t word_weight(std::uint32_t w) noexcept {
    return static_cast<std::uint16_t>(w >> 16U);
  }
  [[nodiscard]] static constexpr std::uint32_t make_word(int distance, int weight) noexcept {
    return (static_cast<std::uint32_t>(distance) & 0xffffU) |
           (static_cast<std::uint32_t>(weight) << 16U);
  }
  // Index of node (x,y,z) within its block, 0 <= x,y,z < 8; z runs fastest.
  [[nodiscard]] static constexpr int in_block(int x, int y, int z) noexcept {
    return (((x & 7) << 3 | (y & 7)) << 3) | (z & 7);
  }
  // Slot of block (bx,by,bz) in its chunk.
  [[nodiscard]] static constexpr int in_chunk(int bx, int by, int bz) noexcept {
    return (((bx & 7) << 3 | (by & 7)) << 3) | (bz & 7);
  }

  // --- chunks: what raycast, patch copy and the readers walk.
  struct Chunk {
    std::array<std::int32_t, kChunkBlocks> block;  // pool index or kNoBlock
    std::array<std::uint64_t, kChunkBlocks> free;  // one bit per 2^3 nodes, bit (x*4+y)*4+z
    std::array<std::uint64_t, 8> settled;  // bit by*8+bz of word bx: block allocated, or all free
    BlockCoord coord;                      // in chunks
    std::int32_t blocks;                   // allocated
    std::uint32_t carved;                  // frame that last carved here
  };
  // Where a chunk stands that is not in use: at no place a camera can be.
  static constexpr BlockCoord kNowhere{-(1 << 24), -(1 << 24), -(1 << 24)};

  // --- for vector kernels: the arrays themselves. Chunk n's table of block numbers begins at
  // n * table_stride; table `empty_table` holds no block, block `empty_block` holds zeros. ahead[8
  // b + n]: the block one to the x (n bit 2), y (bit 1), z (bit 0) of block b; empty_block where
  // none is. empty_block is the last block. Behind it kWordsBehind words may be loaded: a kernel
  // loads the corners of a cell, up to (x + 1, y + 1, z + 1), before it knows if its ray is in the
  // map.
  static constexpr std::size_t kWordsBehind = 64 + 8 + 1;
  struct Arrays {
    const std::int32_t* tables;
    const std::int32_t* words;
    const std::int32_t* ahead;
    std::int32_t table_stride, empty_table, empty_block;
  };
};

}  // namespace perception
