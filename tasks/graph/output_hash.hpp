// What a committed message weighs in run.log_hash and in a replay: every field that it carries, as it left the
// edge's gate. Called only where outputs are hashed (virtual clock, recording); out of line, so
// that the nodes carry nothing of it. Floating-point numbers count by their bits.
//
// Left out: what lies in a slot beyond the message (cells past the size of a grid, points past the
// end of a path), since a slot keeps what an older message left there.
#pragma once

#include "drivers/link/encoded_frame.hpp"
#include "drivers/link/messages.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "rt/hash.hpp"
#include "tasks/fusion/scene_view.hpp"
#include "tasks/graph/messages.hpp"
#include "tasks/graph/object_list.hpp"
#include "tasks/graph/surface_points.hpp"

namespace tasks {

void hash_output(rt::Hash64& h, const Vec3& v) noexcept;  // a force
void hash_output(rt::Hash64& h, const HapticState& m) noexcept;
// Without the gap flag: the ring sets it, by how full it is.
void hash_output(rt::Hash64& h, const TouchEvent& m) noexcept;
void hash_output(rt::Hash64& h, const CameraPose& m) noexcept;
void hash_output(rt::Hash64& h, const OdometryFrame& m) noexcept;
void hash_output(rt::Hash64& h, const Path& m) noexcept;
void hash_output(rt::Hash64& h, const TaskState& m) noexcept;
void hash_output(rt::Hash64& h, const ModeMsg& m) noexcept;
// By its checksum; the field itself where the writer made none.
void hash_output(rt::Hash64& h, const perception::SurfacePatch& m) noexcept;
void hash_output(rt::Hash64& h, const SurfacePoints& m) noexcept;  // without the padding
void hash_output(rt::Hash64& h, const SceneView& m) noexcept;
void hash_output(rt::Hash64& h, const perception::MeshDelta& m) noexcept;
void hash_output(rt::Hash64& h, const ObjectList& m) noexcept;
void hash_output(rt::Hash64& h, const perception::CostMap& m) noexcept;
void hash_output(rt::Hash64& h, const drivers::RobotGoal& m) noexcept;
void hash_output(rt::Hash64& h, const drivers::RobotState& m) noexcept;
void hash_output(rt::Hash64& h, const drivers::MotorSetpoints& m) noexcept;
void hash_output(rt::Hash64& h, const drivers::EncodedFrame& m) noexcept;

}  // namespace tasks
