// What a latch took from outside its box's edges, as a recording holds it (input_record.hpp).
#pragma once

#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/robot_graph.hpp"
#include "tools/record/input_record.hpp"

namespace teletact {

[[nodiscard]] StatusInput status_input(const tasks::LatchedStatus& s) noexcept;
// `taken`: events off the ring of touches since the start.
[[nodiscard]] TouchInput touch_input(std::uint64_t taken, const tasks::LatchedStatus& s) noexcept;
[[nodiscard]] DriveInput drive_input(const tasks::LatchedStatus& s) noexcept;
[[nodiscard]] SceneInput scene_input(const tasks::LatchedStatus& s) noexcept;
[[nodiscard]] CameraInput camera_input(std::uint8_t status, const tasks::LatchedDemand& d) noexcept;

}  // namespace teletact
