// The objects that the operator has touched and that fusion follows: for the console, and as
// targets of a grasp or an approach. fusion -> planning, console; in every period in which an image
// was consumed or a touch answered.
#pragma once

#include <array>
#include <cstdint>

#include "perception/objects/object_map.hpp"
#include "rt/time.hpp"

namespace tasks {

struct ObjectList {
  struct Entry {
    std::uint8_t id = 0;       // label in the map and slot of the patch's palette, 1 ..
    std::uint32_t serial = 0;  // of the object; unlike an id it is never used again
    bool seen = false;         // when it was last looked for
    bool summarised = false;   // the fields below are valid
    perception::Pose X_WO = perception::Pose::Identity();   // centroid and principal axes
    perception::Vec3 extent_m{0, 0, 0}, centre_m{0, 0, 0};  // of the box along the axes, in O
    perception::Rgb colour;                                 // mean
  };
  std::uint64_t seq = 0;  // 0 = never published
  rt::Time exposure{};    // of the newest claimed image
  std::int32_t size = 0;
  std::array<Entry, perception::ObjectMap::kMost> entries{};
  // Of the newest mark that was answered.
  std::uint64_t mark_seq = 0;
  perception::TouchAnswer answer = perception::TouchAnswer::kNone;
  std::uint8_t touched = 0;  // id
};

}  // namespace tasks
