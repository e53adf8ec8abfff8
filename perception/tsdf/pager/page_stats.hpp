#pragma once

#include <cstdint>

namespace perception {

// Of one page() or fetch_view(). Counts are of chunks unless they say otherwise.
struct PageStats {
  std::int32_t put_away = 0, brought_back = 0;
  std::int32_t blocks_moved = 0;
  std::int32_t waiting = 0;         // near, and left for the next call: the budget was spent
  std::int32_t refused = 0;         // fault when > 0: near, and the pool has no room for it
  std::int32_t not_stored = 0;      // far, and the far store is full: stays in the pool
  std::int32_t labels_refused = 0;  // came back without labels: their pool is full
};

}  // namespace perception
