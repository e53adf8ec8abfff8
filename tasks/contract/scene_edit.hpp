// The operator's edits of the scene: forget a region, or keep out of an area. console -> fusion,
// Ring. Plain data, so that a recording can hold it.
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
  };
  static constexpr std::uint16_t kAll = 0;  // id of kErase: all that the operator has drawn
  std::uint64_t seq = 0;
  rt::Time stamp{};
  Kind kind = Kind::kClear;
  std::uint16_t id = 0;  // of an obstacle, chosen by the operator, 1 ..
  std::array<double, 3> centre_W{}, half_m{};
  double yaw_rad = 0;
};

}  // namespace tasks
