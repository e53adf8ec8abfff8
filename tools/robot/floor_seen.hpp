// The floor in one depth image: what tells how high a camera is mounted.
#pragma once

#include <cstdint>
#include <optional>

#include "perception/geometry/rgbd_frame.hpp"
#include "tools/robot/identify_robot.hpp"

namespace teletact {

// Searched about the plane that the stated mount expects: within 20 degrees and 0.3 m, out to 3 m. None: no plane there.
[[nodiscard]] std::optional<FloorSeen> floor_seen(const perception::RgbdFrame& frame,
                                                  const perception::Pose& X_BC,
                                                  std::uint64_t stream);

}  // namespace teletact
