// Places of the world in which something was seen to move, and since when: a hashed table of cells
// of rest_cell_m. A place that has been filled for long is part of the scene again.
//
// Noexcept, no allocation after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/pose.hpp"

namespace perception::motion {

class PlaceMemory {
 public:
  struct Place {
    std::int32_t x = 0, y = 0, z = 0;   // cell
    std::uint32_t first = 0, last = 0;  // frames in which something was seen there; 0: empty
    [[nodiscard]] int age() const noexcept { return static_cast<int>(last - first); }
  };

  explicit PlaceMemory(double cell_m);
  void forget() noexcept;
  // Frames are counted from 1 on.
  void begin(std::uint64_t frame) noexcept { now_ = static_cast<std::uint32_t>(frame); }

  // The place that a point lies in; nullptr: none is kept. `make`: keeps it, unless all that it may
  // lie at are taken. `seen`: something is there now.
  [[nodiscard]] Place* find(const Vec3f& p_W, bool make, bool seen = true) noexcept;
  // Is a place beside the point filled for `frames` or longer? By noise a point of a thing that
  // stands lies now in one place, now in the next.
  [[nodiscard]] bool rested_beside(const Vec3f& p_W, int frames) noexcept;

  // A bit for each slot (place_slot()) that may hold a place.
  [[nodiscard]] const std::uint32_t* taken() const noexcept { return taken_.data(); }

 private:
  double cell_m_;
  std::uint32_t now_ = 0;
  std::vector<Place> places_;  // place_slot() says which
  std::vector<std::uint32_t> taken_;
};

}  // namespace perception::motion
