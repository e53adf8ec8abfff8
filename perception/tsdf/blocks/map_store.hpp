// The content of a map: blocks with their labels in pools, and the scale of their distances. Pager,
// integrator, label votes and decay change it; readers see it through a MapView.
//
// Units     voxel, truncation: m; metres_per_unit: of a raw distance.
// Thread    the thread that changes the map; workers of its crew, block by block.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "perception/tsdf/blocks/block_pool.hpp"
#include "perception/tsdf/blocks/label_pool.hpp"
#include "perception/tsdf/blocks/tsdf_config.hpp"
#include "rt/hash.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct MapStore : MapLayout {
  // Throws std::invalid_argument naming the key, value and range.
  MapStore(rt::NonRealtime&, const TsdfConfig&);
  MapStore(const MapStore&) = delete;
  MapStore& operator=(const MapStore&) = delete;

  const TsdfConfig config;
  const double voxel, truncation;
  const float metres_per_unit;
  std::uint32_t map_id = 1;  // changes when everything is forgotten
  BlockPool blocks;
  LabelPool labels;

  void clear() noexcept;
  // A block with its labels.
  void drop_block(Chunk& c, int slot) noexcept;
  // The same; what it knew of free space stays with the chunk.
  void free_block(Chunk& c, int slot) noexcept;
  // Nodes `lo` .. `hi`, both included, become unknown; blocks left without any weight go.
  void clear_nodes(const std::array<int, 3>& lo, const std::array<int, 3>& hi) noexcept;

  // Label of a voxel whose block holds no labels, as the images so far would have left it:
  // background if it lies within the band of the surface, with the weight of the images that can
  // have seen it.
  [[nodiscard]] LabelVoxel implied_background(std::uint32_t word) const noexcept {
    const int units = word_distance(word);
    const bool near =
        static_cast<float>(units < 0 ? -units : units) * metres_per_unit <= kLabelBand_m;
    const int seen = word_weight(word) / kWeightOne, images = labels.images();
    return {0, static_cast<std::uint8_t>(near ? (seen < images ? seen : images) : 0)};
  }

  // All stored words, colours, labels and free bits, in allocation order.
  void add_to(rt::Hash64& h) const noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept {  // held beside the object itself
    return blocks.memory_bytes() + labels.memory_bytes();
  }

 private:
  void clear_in_block(Chunk& c, int slot, const std::array<int, 3>& lo,
                      const std::array<int, 3>& hi) noexcept;
};

// Free bits of a block from the bits of its 2^3 cells, and back (a cell is free when all of it is).
void expand_free(std::uint64_t cells, std::uint64_t* bits) noexcept;
[[nodiscard]] std::uint64_t shrink_free(const std::uint64_t* bits) noexcept;

}  // namespace perception
