// The operator's edits of the scene: forget a region, keep out of an area, name an object. console
// -> fusion, Ring. Plain data, so that a recording can hold it.
#pragma once

#include <array>
#include <cstdint>

#include "rt/time.hpp"

namespace tasks {

struct SceneEdit {
  enum class Kind : std::uint8_t {
    kClear,  // the box centre_W +- half_m is forgotten: voxels, free space, obstacles of the cost map
    kDrawDisc,  // no-go disc about centre_W, radius half_m[0]; replaces the one of the same id
    kDrawBox,   // no-go box, half edges half_m[0], half_m[1], turned by yaw_rad
    kErase,     // of this id
    // An object is given by its boxes, one an edit, then by a point of its surface. A box whose id
    // is 1 begins; what does not count up from there is refused, and so nothing half is named.
    kObjectBox,    // id-th box: the surface within centre_W +- half_m is of the object
    kObjectPoint,  // centre_W; id: how many boxes there were. Now it is an object
    kDropObject,   // is none any more; id: the lower 16 bits of its serial
  };
  static constexpr std::uint16_t kAll = 0;  // id of kErase: all that the operator has drawn
  std::uint64_t seq = 0;
  rt::Time stamp{};
  Kind kind = Kind::kClear;
  std::uint16_t id = 0;  // of an obstacle, chosen by the operator, 1 ..; of the others see above
  std::array<double, 3> centre_W{}, half_m{};
  double yaw_rad = 0;
};

}  // namespace tasks
