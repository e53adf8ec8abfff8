// A chunk with its blocks as one run of bytes (little-endian):
//
//   head     x, y, z (int32), carved (uint32), blocks, blocks with labels (uint16), labels that
//            occur (uint32)
//   free     of the 512 words of 2^3-node cells: which are not 0 (64 bytes), which are all ones (64
//            bytes), then the others as they are
//   blocks   slot (uint16, rising), bytes (uint16), the block (block_codec.hpp)
//
// A sink is called with spans and says whether there was room; a source fills spans and says
// whether that many bytes were left.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "perception/tsdf/blocks/map_layout.hpp"
#include "perception/tsdf/pager/block_codec.hpp"

namespace perception {

static_assert(std::endian::native == std::endian::little,
              "records are written as they lie in memory");

struct ChunkHead {
  std::int32_t x = 0, y = 0, z = 0;
  std::uint32_t carved = 0;
  std::uint16_t blocks = 0, label_blocks = 0;
  std::uint32_t labels = 0;
};
static_assert(sizeof(ChunkHead) == 24);

inline constexpr std::size_t kLeastRecordBytes = sizeof(ChunkHead) + 128;
inline constexpr std::size_t kMostRecordBytes =
    kLeastRecordBytes + MapLayout::kChunkBlocks * (8 + 4 + kMostBlockBytes);

class SpanSource {
 public:
  explicit SpanSource(std::span<const std::uint8_t> bytes) noexcept : bytes_(bytes) {}
  [[nodiscard]] bool read(std::span<std::uint8_t> out) noexcept {
    if (out.size() > bytes_.size()) return false;
    std::memcpy(out.data(), bytes_.data(), out.size());
    bytes_ = bytes_.subspan(out.size());
    return true;
  }
  [[nodiscard]] std::size_t left() const noexcept { return bytes_.size(); }

 private:
  std::span<const std::uint8_t> bytes_;
};

template <class T>
std::span<const std::uint8_t> bytes_of(const T& v) noexcept {
  static_assert(std::is_trivially_copyable_v<T>);
  return {reinterpret_cast<const std::uint8_t*>(&v), sizeof v};
}
template <class T>
std::span<std::uint8_t> bytes_into(T& v) noexcept {
  static_assert(std::is_trivially_copyable_v<T>);
  return {reinterpret_cast<std::uint8_t*>(&v), sizeof v};
}

using FreeCells = std::array<std::uint64_t, MapLayout::kChunkBlocks>;
using SlotBits = std::array<std::uint64_t, MapLayout::kChunkBlocks / 64>;

template <class Sink>
bool write_cells(const FreeCells& cells, Sink& sink) noexcept {
  SlotBits some{}, all{};
  for (std::size_t i = 0; i < cells.size(); ++i) {
    some[i >> 6U] |= std::uint64_t{cells[i] != 0} << (i & 63U);
    all[i >> 6U] |= std::uint64_t{cells[i] == ~0ULL} << (i & 63U);
  }
  if (!sink(bytes_of(some)) || !sink(bytes_of(all))) return false;
  for (const std::uint64_t c : cells)
    if (c != 0 && c != ~0ULL && !sink(bytes_of(c))) return false;
  return true;
}

template <class Source>
bool read_cells(Source& source, FreeCells& cells) noexcept {
  SlotBits some, all;
  if (!source.read(bytes_into(some)) || !source.read(bytes_into(all))) return false;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const bool is_some = ((some[i >> 6U] >> (i & 63U)) & 1U) != 0;
    const bool is_all = ((all[i >> 6U] >> (i & 63U)) & 1U) != 0;
    if (is_all && !is_some) return false;
    cells[i] = is_all ? ~0ULL : 0;
    if (is_some && !is_all) {
      if (!source.read(bytes_into(cells[i])) || cells[i] == 0 || cells[i] == ~0ULL) return false;
    }
  }
  return true;
}

// The next block of a record.
template <class Source>
bool read_block(Source& source, std::uint16_t& slot, BlockImage& out) noexcept {
  std::uint16_t bytes = 0;
  std::array<std::uint8_t, kMostBlockBytes> body;
  if (!source.read(bytes_into(slot)) || !source.read(bytes_into(bytes))) return false;
  if (slot >= MapLayout::kChunkBlocks || bytes > body.size()) return false;
  const std::span<std::uint8_t> part(body.data(), bytes);
  return source.read(part) && decode_block(part, out);
}

}  // namespace perception
