#include "tasks/edges/output_hash.hpp"

#include "perception/tsdf/patch/patch_copy.hpp"

// What is not in a field list is taken apart by a structured binding: a field that is added to such
// a struct does not compile until it is looked at here.
namespace tasks {

namespace weigh {

namespace {

template <class... T>
void all(rt::Hash64& h, const T&... fields) noexcept {
  (one(h, fields), ...);
}

}  // namespace

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

void apart(rt::Hash64& h, const Path& m) noexcept {
  for (std::int32_t i = 0; i < m.size; ++i) one(h, m.points[static_cast<std::size_t>(i)]);
}

void apart(rt::Hash64& h, const SurfacePoints& m) noexcept {
  for (const auto* v : {&m.x, &m.y, &m.z, &m.nx, &m.ny, &m.nz})
    h.bytes(v->data(), m.count * sizeof(float));
}

void apart(rt::Hash64& h, const SceneView& m) noexcept {
  const auto pixels =
      static_cast<std::size_t>(m.intrinsics.width) * static_cast<std::size_t>(m.intrinsics.height);
  h.bytes(m.colour.data(), pixels * sizeof m.colour[0]);
  h.bytes(m.points.data(), pixels * sizeof m.points[0]);
  h.bytes(m.object.data(), pixels);
  if (m.masked) h.bytes(m.what.data(), pixels);
}

void apart(rt::Hash64& h, const perception::MeshDelta& m) noexcept {
  for (std::int32_t i = 0; i < m.block_count; ++i) {
    const auto& [at, version, block_vertices, block_triangles] =
        m.blocks[static_cast<std::size_t>(i)];
    all(h, at.x, at.y, at.z, version, block_vertices, block_triangles);
  }
  h.bytes(m.vertices.data(), static_cast<std::size_t>(m.vertex_count) * sizeof m.vertices[0]);
  h.bytes(m.triangles.data(), static_cast<std::size_t>(m.triangle_count) * sizeof m.triangles[0]);
}

void apart(rt::Hash64& h, const ObjectList& m) noexcept {
  for (std::int32_t i = 0; i < m.size; ++i) {
    const auto& [id, serial, seen, summarised, X_WO, extent_m, centre_m, colour] =
        m.entries[static_cast<std::size_t>(i)];
    const auto& [r, g, b] = colour;
    all(h, id, serial, seen, summarised, X_WO, extent_m, centre_m, r, g, b);
  }
}

void apart(rt::Hash64& h, const perception::CostMap& m) noexcept {
  const auto cells = static_cast<std::size_t>(m.width) * static_cast<std::size_t>(m.height);
  h.bytes(m.cost.data(), cells);
  h.bytes(m.height_m.data(), cells * sizeof m.height_m[0]);
  if (m.moving_count > 0)
    h.bytes(m.moving.data(), static_cast<std::size_t>(m.moving_count) * sizeof m.moving[0]);
}

void apart(rt::Hash64& h, const perception::SurfacePatch& m) noexcept {
  one(h, m.checksum != 0 ? m.checksum : perception::patch_checksum(m));
}

}  // namespace weigh

void hash_output(rt::Hash64& h, const Vec3& v) noexcept { weigh::one(h, v); }

void hash_output(rt::Hash64& h, const drivers::MotorSetpoints& m) noexcept {
  const auto& [mode, wheels] = m;
  weigh::one(h, mode);
  weigh::one(h, wheels);
}

namespace {

void hash_joints(rt::Hash64& h, const perception::JointAngles& m) noexcept {
  const auto& [count, position, speed, error, age_s] = m;
  weigh::all(h, count, error, age_s);
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
    weigh::all(h, position[i], speed[i]);
}

}  // namespace

void hash_output(rt::Hash64& h, const drivers::EncodedFrame& m) noexcept {
  const auto& [exposure, seq, intrinsics, has_colour, needs_previous, depth_codec, spared, demand,
               joints, depth_size, colour_size, bytes] = m;
  weigh::all(h, exposure.box, exposure.ns, seq, intrinsics, has_colour, depth_size, colour_size);
  if (joints.count > 0) hash_joints(h, joints);
  if (spared.rungs > 0) weigh::all(h, spared.rungs, spared.why);
  // Of frames that stand alone and answer nobody there is nothing more to say.
  if (demand != 0 || needs_previous || depth_codec != drivers::DepthCodecId::kLossless)
    weigh::all(h, demand, needs_previous, depth_codec);
  h.bytes(bytes.data(), std::size_t{depth_size} + colour_size);
}

}  // namespace tasks
