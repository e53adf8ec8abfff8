// Finds the floor in one depth image. It gives the camera's height.
#pragma once

#include <cstdint>
#include <optional>

#include "perception/geometry/rgbd_frame.hpp"
#include "tools/robot/identify_robot.hpp"

namespace teletact {

// Searches round the plane that the stated mount expects: within 20 degrees and 0.3 m, out to 3 m.
// None: no plane there.
[[nodiscard]] std::optional<FloorSeen> floor_seen(const perception::RgbdFrame& frame,
                                                  const perception::Pose& X_BC,
                                                  std::uint64_t stream);

}  // namespace teletact
