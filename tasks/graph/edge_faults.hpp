// Message faults: what a fault plan does to the messages of one edge, where they are committed or
// arrive. Without a plan an edge costs one branch.
//
//   drop       not published: the reader keeps what it has
//   duplicate  published twice, under two sequence numbers
//   stale      every stamp in it is that much older
//   nan        its numbers are NaN (edges that carry any)
//   ring_full  rings only: refused as by a full ring; so is a `drop` there, since a ring in memory
//              loses nothing behind its writer's back. The next event that fits carries the gap
//              flag.
//
// Messages that cross the boxes are counted where they arrive, behind the wire's own checks; all
// others where they are published.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "drivers/link/messages.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "rt/channel/latest.hpp"
#include "rt/fault/plan.hpp"
#include "rt/result.hpp"
#include "tasks/fusion/scene_edit.hpp"
#include "tasks/fusion/scene_view.hpp"
#include "tasks/graph/messages.hpp"
#include "tasks/graph/object_list.hpp"
#include "tasks/graph/surface_points.hpp"
#include "tasks/graph/table.hpp"

namespace tasks {

// One clear error when a plan names a task or an edge that kTaskTable and kEdgeTable do not have,
// or a kind that its edge can not show.
[[nodiscard]] rt::Result<bool> check_faults(const rt::FaultPlan& plan);
// Does `kind` mean anything on this edge?
[[nodiscard]] bool edge_takes(EdgeId edge, rt::FaultKind kind) noexcept;

class EdgeGate {
 public:
  EdgeGate() = default;
  EdgeGate(const rt::FaultPlan& plan, std::string_view edge) : plan_(plan, edge) {}
  // Fate of the next message; counts messages, so the decision is by sequence number.
  [[nodiscard]] rt::EdgeFaults next() noexcept { return plan_.edge(seq_++); }
  [[nodiscard]] bool empty() const noexcept { return plan_.empty(); }

 private:
  rt::TargetPlan plan_;
  std::uint64_t seq_ = 0;
};

namespace edge {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr float kNanF = std::numeric_limits<float>::quiet_NaN();

inline void age(perception::RgbdFrame& m, rt::Nanos by) noexcept { m.exposure -= by; }
inline void age(drivers::RobotState& m, rt::Nanos by) noexcept { m.taken -= by; }
inline void age(drivers::RobotGoal& m, rt::Nanos by) noexcept { m.made -= by, m.valid_until -= by; }
inline void age(perception::SurfacePatch& m, rt::Nanos by) noexcept {
  m.fused -= by, m.exposure -= by;
}
inline void age(SurfacePoints& m, rt::Nanos by) noexcept { m.fused -= by, m.exposure -= by; }
inline void age(SceneView& m, rt::Nanos by) noexcept { m.fused -= by, m.exposure -= by; }
inline void age(perception::MeshDelta& m, rt::Nanos by) noexcept {
  m.fused -= by, m.exposure -= by;
}
inline void age(SceneEdit& m, rt::Nanos by) noexcept { m.stamp -= by; }
inline void age(perception::CostMap& m, rt::Nanos by) noexcept { m.fused -= by, m.exposure -= by; }
inline void age(CameraPose& m, rt::Nanos by) noexcept { m.exposure -= by, m.seen -= by; }
inline void age(ObjectList& m, rt::Nanos by) noexcept { m.exposure -= by; }
inline void age(HapticState& m, rt::Nanos by) noexcept { m.stamp -= by; }
inline void age(TouchEvent& m, rt::Nanos by) noexcept { m.stamp -= by; }
inline void age(Path& m, rt::Nanos by) noexcept { m.made -= by, m.mark_stamp -= by, m.seen -= by; }
inline void age(TaskState& m, rt::Nanos by) noexcept { m.stamp -= by; }
inline void age(OdometryFrame& m, rt::Nanos by) noexcept { m.taken -= by, m.claimed -= by; }
inline void age(ModeMsg& m, rt::Nanos by) noexcept { m.stamp -= by; }

// Messages without floating-point numbers; check_faults() refuses the kind for them.
inline void spoil(perception::RgbdFrame&) noexcept {}
inline void spoil(TaskState&) noexcept {}
inline void spoil(ModeMsg&) noexcept {}
inline void spoil(drivers::RobotState& m) noexcept {
  m.x_m = m.y_m = m.yaw_rad = m.vx = m.vy = m.wz = kNan;
}
inline void spoil(drivers::RobotGoal& m) noexcept {
  m.x_m = m.y_m = m.yaw_rad = m.vx = m.vy = m.wz = m.speed_limit_m_per_s = kNan;
}
inline void spoil(perception::SurfacePatch& m) noexcept {
  m.voxel_size = kNan;
  m.metres_per_unit = kNanF;
}
inline void spoil(SurfacePoints& m) noexcept {
  m.X_WC.matrix().setConstant(kNan);
  for (auto* v : {&m.x, &m.y, &m.z, &m.nx, &m.ny, &m.nz}) std::fill(v->begin(), v->end(), kNanF);
}
inline void spoil(SceneView& m) noexcept { m.points.fill({kNanF, kNanF, kNanF, kNanF}); }
inline void spoil(perception::MeshDelta& m) noexcept {
  for (auto& v : m.vertices) v.x = v.y = v.z = kNanF;
}
inline void spoil(SceneEdit& m) noexcept {
  m.centre_W.fill(kNan), m.half_m.fill(kNan);
  m.yaw_rad = kNan;
}
inline void spoil(perception::CostMap& m) noexcept {
  m.resolution = kNan;
  m.X_WM.matrix().setConstant(kNan);
}
inline void spoil(CameraPose& m) noexcept { m.X_WC.matrix().setConstant(kNan); }
inline void spoil(ObjectList& m) noexcept {
  for (auto& e : m.entries) {
    e.X_WO.matrix().setConstant(kNan);
    e.extent_m = e.centre_m = Vec3::Constant(kNan);
  }
}
inline void spoil(HapticState& m) noexcept {
  m.p_WH = m.v_WH = m.p_WP = m.f_H_W = m.normal_W = Vec3::Constant(kNan);
}
inline void spoil(TouchEvent& m) noexcept {
  m.p_W = m.normal_W = Vec3::Constant(kNan);
  m.force_N = kNan;
}
inline void spoil(Path& m) noexcept {
  for (auto& p : m.points) p.fill(kNan);
  m.marked_W = Vec3::Constant(kNan);
}
inline void spoil(OdometryFrame& m) noexcept {
  m.X_WO.fill(kNan), m.covariance.fill(kNan);
  m.error_m = m.error_rad = kNan;
}

}  // namespace edge

// Publishes `slot`, which is cell.begin_write() filled, through the gate. True: it is out. `at`, `unsure`: of the
// publication (rt::Latest).
template <class T>
bool publish(EdgeGate& gate, rt::Latest<T>& cell, T& slot, rt::Time at,
             rt::Nanos unsure = rt::Nanos{0}) noexcept {
  if (gate.empty()) {
    cell.publish(at, unsure);
    return true;
  }
  const rt::EdgeFaults fate = gate.next();
  if (fate.drop) return false;
  if (fate.stale.count() != 0) edge::age(slot, fate.stale);
  if (fate.nan) edge::spoil(slot);
  cell.publish(at, unsure);
  if (fate.duplicate) {
    // The published slot is read by others and written by nobody until the next publish.
    cell.begin_write() = slot;
    cell.publish(at, unsure);
  }
  return true;
}

// A ring with its gap flag: after an event that did not fit, the next one that does says so.
template <class Ring>
void push(EdgeGate& gate, Ring& ring, TouchEvent event, bool& gap) noexcept {
  rt::EdgeFaults fate;
  if (!gate.empty()) {
    fate = gate.next();
    if (fate.stale.count() != 0) edge::age(event, fate.stale);
    if (fate.nan) edge::spoil(event);
  }
  event.gap = gap;
  if (fate.ring_full || fate.drop || !ring.try_push(event)) {
    gap = true;
    return;
  }
  gap = false;
  if (fate.duplicate) {
    event.gap = false;
    gap = !ring.try_push(event);
  }
}

// A ring whose writer asks again: false, as by a full ring.
template <class Ring>
[[nodiscard]] bool push(EdgeGate& gate, Ring& ring, SceneEdit edit) noexcept {
  rt::EdgeFaults fate;
  if (!gate.empty()) {
    fate = gate.next();
    if (fate.stale.count() != 0) edge::age(edit, fate.stale);
    if (fate.nan) edge::spoil(edit);
  }
  if (fate.ring_full || fate.drop || !ring.try_push(edit)) return false;
  if (fate.duplicate) static_cast<void>(ring.try_push(edit));
  return true;
}

}  // namespace tasks
