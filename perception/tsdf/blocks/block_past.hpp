// History of a block: how far earlier readings lay off its surface. Used to follow surfaces that
// move slowly (follow/follow.hpp). The pool keeps it with the block; a new block has none.
#pragma once

#include <array>
#include <cstdint>

namespace perception {

// How far readings lay behind (+) or before (-) a block's surface, m along their rays. Newer
// readings count more.
struct OffsetSums {
  float count = 0, sum = 0, squares = 0;
  void add(float off) noexcept { count += 1, sum += off, squares += off * off; }
};

struct BlockPast {
  OffsetSums now, before;        // of this frame's readings; of earlier ones
  float z_m = 0;                 // depth of the last reading
  std::uint32_t frame = 0;       // that `now` is of
  std::uint32_t moved = 0;       // the last frame in which the block was moved
  std::array<float, 3> eye_W{};  // where it was seen from, the mean of what the map remembers
  float eyes = 0;                // readings of it
};

}  // namespace perception
