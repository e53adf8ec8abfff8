#include "tasks/planning/flood.hpp"

#include <algorithm>

namespace tasks {

namespace {
std::size_t at(std::int32_t i) { return static_cast<std::size_t>(i); }
}  // namespace

void Flood::unlink(std::int32_t cell) noexcept {
  const std::int32_t n = next_[at(cell)], b = before_[at(cell)];
  if (n != kNone) before_[at(n)] = b;
  if (b != kNone) {
    next_[at(b)] = n;
  } else {
    head_[at(length_[at(cell)] % kBuckets)] = n;
  }
  --queued_;
}

void Flood::relax(std::int32_t cell, std::int32_t length, std::int32_t parent) noexcept {
  const std::int32_t old = length_[at(cell)];
  if (length >= old) return;
  // A settled cell never gets shorter, so a finite length means that it is still queued.
  if (old != kFar) unlink(cell);
  length_[at(cell)] = length;
  parent_[at(cell)] = parent;
  std::int32_t& head = head_[at(length % kBuckets)];
  next_[at(cell)] = head;
  before_[at(cell)] = kNone;
  if (head != kNone) before_[at(head)] = cell;
  head = cell;
  ++queued_;
}

bool Flood::run(const perception::CostMap& map, std::span<const Seed> seeds, std::uint8_t limit,
                const rt::Tick& tick) noexcept {
  const int w = map.width, h = map.height;
  std::fill_n(length_.begin(), at(w * h), kFar);
  head_.fill(kNone);
  count_ = 0;
  queued_ = 0;
  limit_ = limit;
  const auto passable = [&](int x, int y) {
    return map.contains(x, y) && map.cost[map.index(x, y)] <= limit;
  };
  for (const Seed& s : seeds) {
    if (map.cost[at(s.cell)] > limit) continue;
    relax(s.cell, std::min(s.length, kBuckets - kDiagonal - 1), s.cell);
  }
  for (std::int32_t length = 0; queued_ > 0; ++length) {
    for (std::int32_t c = head_[at(length % kBuckets)]; c != kNone;
         c = head_[at(length % kBuckets)]) {
      unlink(c);
      cells_[at(count_++)] = c;
      if ((count_ & 1023) == 0 && tick.cancelled()) return false;
      const int x = c % w, y = c / w;
      const bool left = passable(x - 1, y), right = passable(x + 1, y);
      const bool down = passable(x, y - 1), up = passable(x, y + 1);
      if (left) relax(c - 1, length + kStraight, c);
      if (right) relax(c + 1, length + kStraight, c);
      if (down) relax(c - w, length + kStraight, c);
      if (up) relax(c + w, length + kStraight, c);
      if (left && down && passable(x - 1, y - 1)) relax(c - w - 1, length + kDiagonal, c);
      if (right && down && passable(x + 1, y - 1)) relax(c - w + 1, length + kDiagonal, c);
      if (left && up && passable(x - 1, y + 1)) relax(c + w - 1, length + kDiagonal, c);
      if (right && up && passable(x + 1, y + 1)) relax(c + w + 1, length + kDiagonal, c);
    }
  }
  return count_ > 0;
}

}  // namespace tasks
