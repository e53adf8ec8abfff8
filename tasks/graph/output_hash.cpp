#include "tasks/graph/output_hash.hpp"

#include <concepts>

#include "perception/tsdf/patch/patch_copy.hpp"

// Each message but the hand is taken apart by a structured binding: a field that is added to one does
// not compile until it is hashed here.
namespace tasks {

namespace {

template <class T>
requires std::integral<T> || std::is_enum_v<T>
void one(rt::Hash64& h, T v) noexcept { h.word(static_cast<std::uint64_t>(v)); }
template <std::floating_point T>
void one(rt::Hash64& h, T v) noexcept {
  h.value(v);
}
void one(rt::Hash64& h, rt::Time t) noexcept { one(h, rt::ns_of(t)); }
void one(rt::Hash64& h, rt::Stamp s) noexcept {
  one(h, s.box);
  one(h, s.ns);
}
void one(rt::Hash64& h, const Vec3& v) noexcept {
  for (int i = 0; i < 3; ++i) h.value(v(i));
}
void one(rt::Hash64& h, const Pose& X) noexcept {
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 3; ++r) h.value(X.matrix()(r, c));
  }
}
void one(rt::Hash64& h, const perception::Intrinsics& k) noexcept {
  const auto& [fx, fy, cx, cy, width, height] = k;
  for (const double v : {fx, fy, cx, cy}) h.value(v);
  for (const int v : {width, height}) one(h, v);
}
void one(rt::Hash64& h, const perception::Material& m) noexcept {
  const auto& [stiffness, friction_static, friction_dynamic, amplitude, period] = m;
  for (const float v : {stiffness, friction_static, friction_dynamic, amplitude, period})
    h.value(v);
}

template <class... T>
void all(rt::Hash64& h, const T&... fields) noexcept {
  (one(h, fields), ...);
}

// By name: the mark is hashed where the hand's state carries one.
template <class M>
void hash_hand(rt::Hash64& h, const M& m) noexcept {
  all(h, m.seq, m.stamp, m.p_WH, m.v_WH, m.p_WP, m.f_H_W, m.normal_W, m.contacts, m.button,
      m.patch_seq);
  if constexpr (requires { m.mark_seq; }) all(h, m.mark_seq, m.p_mark_W);
}

}  // namespace

void hash_output(rt::Hash64& h, const Vec3& v) noexcept { one(h, v); }

void hash_output(rt::Hash64& h, const HapticState& m) noexcept { hash_hand(h, m); }

void hash_output(rt::Hash64& h, const TouchEvent& m) noexcept {
  const auto& [seq, stamp, kind, gap, p_W, normal_W, force_N] = m;
  all(h, seq, stamp, kind, p_W, normal_W, force_N);
}

void hash_output(rt::Hash64& h, const CameraPose& m) noexcept {
  const auto& [seq, exposure, X_WC, tracking, claimed, seen] = m;
  all(h, seq, exposure, X_WC, tracking, claimed, seen);
}

void hash_output(rt::Hash64& h, const OdometryFrame& m) noexcept {
  const auto& [seq, taken, claimed, X_WO, covariance, error_m, error_rad, known, follows, unsure,
               held, held_ms, held_limit_ms] = m;
  all(h, seq, taken, claimed, error_m, error_rad, known, follows, unsure, held, held_ms,
      held_limit_ms);
  for (const double v : X_WO) h.value(v);
  for (const double v : covariance) h.value(v);
}

void hash_output(rt::Hash64& h, const Path& m) noexcept {
  const auto& [seq, made, mark_seq, mark_stamp, size, points, marked_W, seen] = m;
  all(h, seq, made, mark_seq, mark_stamp, size, marked_W, seen);
  for (std::int32_t i = 0; i < size; ++i) {
    for (const double c : points[static_cast<std::size_t>(i)]) h.value(c);
  }
}

void hash_output(rt::Hash64& h, const TaskState& m) noexcept {
  const auto& [seq, stamp, phase, marks, paths, failures] = m;
  all(h, seq, stamp, phase, marks, paths, failures);
}

void hash_output(rt::Hash64& h, const ModeMsg& m) noexcept {
  const auto& [seq, stamp, mode, cause, clear] = m;
  all(h, seq, stamp, mode, cause, clear);
}

void hash_output(rt::Hash64& h, const perception::SurfacePatch& m) noexcept {
  const auto& [map_id, seq, fused, exposure, voxel_size, metres_per_unit, origin_node, nodes,
               checksum, touched_moves, palette, distance, material, free] = m;
  all(h, map_id, seq, fused, exposure, voxel_size, metres_per_unit, nodes, touched_moves);
  for (const std::int32_t o : origin_node) one(h, o);
  for (const auto& slot : palette) one(h, slot);
  one(h, checksum != 0 ? checksum : perception::patch_checksum(m));
}

void hash_output(rt::Hash64& h, const SurfacePoints& m) noexcept {
  const auto& [seq, fused, exposure, X_WC, count, x, y, z, nx, ny, nz] = m;
  all(h, seq, fused, exposure, X_WC, count);
  for (const auto* v : {&x, &y, &z, &nx, &ny, &nz}) h.bytes(v->data(), count * sizeof(float));
}

void hash_output(rt::Hash64& h, const SceneView& m) noexcept {
  const auto& [seq, fused, exposure, X_WV, intrinsics, colour, points, object, masked, what] = m;
  all(h, seq, fused, exposure, X_WV, intrinsics);
  const auto pixels =
      static_cast<std::size_t>(intrinsics.width) * static_cast<std::size_t>(intrinsics.height);
  h.bytes(colour.data(), pixels * sizeof colour[0]);
  h.bytes(points.data(), pixels * sizeof points[0]);
  h.bytes(object.data(), pixels);
  if (masked) h.bytes(what.data(), pixels);
}

void hash_output(rt::Hash64& h, const perception::MeshDelta& m) noexcept {
  const auto& [seq, fused, exposure, restart, block_count, vertex_count, triangle_count, blocks,
               vertices, triangles] = m;
  all(h, seq, fused, exposure, restart, block_count, vertex_count, triangle_count);
  for (std::int32_t i = 0; i < block_count; ++i) {
    const auto& [at, version, block_vertices, block_triangles] =
        blocks[static_cast<std::size_t>(i)];
    all(h, at.x, at.y, at.z, version, block_vertices, block_triangles);
  }
  h.bytes(vertices.data(), static_cast<std::size_t>(vertex_count) * sizeof vertices[0]);
  h.bytes(triangles.data(), static_cast<std::size_t>(triangle_count) * sizeof triangles[0]);
}

void hash_output(rt::Hash64& h, const ObjectList& m) noexcept {
  const auto& [seq, exposure, size, entries, mark_seq, answer, touched] = m;
  all(h, seq, exposure, size, mark_seq, answer, touched);
  for (std::int32_t i = 0; i < size; ++i) {
    const auto& [id, serial, seen, summarised, X_WO, extent_m, centre_m, colour] =
        entries[static_cast<std::size_t>(i)];
    const auto& [r, g, b] = colour;
    all(h, id, serial, seen, summarised, X_WO, extent_m, centre_m, r, g, b);
  }
}

void hash_output(rt::Hash64& h, const perception::CostMap& m) noexcept {
  const auto& [seq, fused, exposure, ground_found, resolution, width, height, X_WM, cost, height_m,
               moving_count, moving] = m;
  all(h, seq, fused, exposure, ground_found, resolution, width, height, X_WM);
  const auto cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  h.bytes(cost.data(), cells);
  h.bytes(height_m.data(), cells * sizeof height_m[0]);
  if (moving_count > 0)
    h.bytes(moving.data(), static_cast<std::size_t>(moving_count) * sizeof moving[0]);
}

void hash_output(rt::Hash64& h, const drivers::RobotGoal& m) noexcept {
  const auto& [seq, made, valid_until, x, y, yaw, vx, vy, wz, speed_limit, engaged,
               operator_engaged, operator_clear, path_seq] = m;
  all(h, seq, made, valid_until, x, y, yaw, vx, vy, wz, speed_limit, engaged, operator_engaged,
      operator_clear, path_seq);
}

void hash_output(rt::Hash64& h, const drivers::RobotState& m) noexcept {
  const auto& [seq, taken, x, y, yaw, vx, vy, wz, cmd_vx, cmd_vy, cmd_wz, goal_seq, mode, moving,
               fault] = m;
  all(h, seq, taken, x, y, yaw, vx, vy, wz, cmd_vx, cmd_vy, cmd_wz, goal_seq, mode, moving, fault);
}

void hash_output(rt::Hash64& h, const drivers::MotorSetpoints& m) noexcept {
  const auto& [mode, wheels] = m;
  one(h, mode);
  for (const double w : wheels) h.value(w);
}

namespace {

void hash_joints(rt::Hash64& h, const perception::JointAngles& m) noexcept {
  const auto& [count, position, speed, error, age_s] = m;
  all(h, count, error, age_s);
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) all(h, position[i], speed[i]);
}

}  // namespace

void hash_output(rt::Hash64& h, const drivers::EncodedFrame& m) noexcept {
  const auto& [exposure, seq, intrinsics, has_colour, joints, depth_size, colour_size, bytes] = m;
  all(h, exposure, seq, intrinsics, has_colour, depth_size, colour_size);
  if (joints.count > 0) hash_joints(h, joints);
  h.bytes(bytes.data(), std::size_t{depth_size} + colour_size);
}

}  // namespace tasks
