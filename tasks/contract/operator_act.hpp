// What the operator asks of planning and prediction beside a mark of the hand. Frame W, SI. Plain
// data, so that a recording can hold it.
#pragma once

#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace tasks {

// console -> planning, Ring; one is taken a job, in order.
struct OperatorAct {
  enum class Kind : std::uint8_t {
    kGoTo,    // drive to the foot of p_W on the floor, at the end turned to yaw_rad if `turns`
    kMark,    // p_W was marked on a surface whose normal is normal_W: as a mark of the hand
    kCancel,  // drop goal and path
  };
  std::uint64_t seq = 0;  // from 1 on
  rt::Time stamp{};
  Kind kind = Kind::kCancel;
  bool turns = false;
  perception::Vec3 p_W{0, 0, 0}, normal_W{0, 0, 1};
  double yaw_rad = 0;
};

// The operator drives by hand: a velocity of the base, good for as long as the reader's age limit
// since `stamp`, which is when the operator last said that the key is held. While it is held no
// path is followed. console -> prediction, Latest.
struct DriveIntent {
  std::uint64_t seq = 0;  // 0: never published
  rt::Time stamp{};
  bool held = false;              // false: let go
  double vx = 0, vy = 0, wz = 0;  // body frame, m/s, rad/s
};

}  // namespace tasks
