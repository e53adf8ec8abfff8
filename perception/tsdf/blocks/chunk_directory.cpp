#include "perception/tsdf/blocks/chunk_directory.hpp"

#include <algorithm>

namespace perception {

void ChunkDirectory::fill(const MapView& map, const int (&middle)[3]) noexcept {
  for (int a = 0; a < 3; ++a) corner_[a] = middle[a] - kEdge / 2;
  std::fill(table_.begin(), table_.end(), map.arrays().empty_table);
  for (int n = 0; n < map.chunk_count(); ++n) {
    const BlockCoord at = map.chunk(n).coord;
    add(map, at.x, at.y, at.z, n);
  }
}

void ChunkDirectory::add(const MapView& map, int x, int y, int z, int n) noexcept {
  const int i = x - corner_[0], j = y - corner_[1], k = z - corner_[2];
  if (((i | j | k) & ~(kEdge - 1)) != 0) return;
  table_[static_cast<std::size_t>((i * kEdge + j) * kEdge + k)] = n * map.arrays().table_stride;
}

}  // namespace perception
