// What is committed is hashed whole: any field of any message, by its lowest bit, changes the hash;
// what lies in a slot beyond the message does not.
#include "tasks/edges/output_hash.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <functional>
#include <memory>
#include <vector>

#include "perception/tsdf/patch/patch_copy.hpp"

namespace {

using tasks::hash_output;

template <class M>
std::uint64_t digest(const M& m) {
  rt::Hash64 h;
  hash_output(h, m);
  return h.digest();
}

// The smallest change there is.
void nudge(double& v) { v = std::bit_cast<double>(std::bit_cast<std::uint64_t>(v) ^ 1U); }
void nudge(float& v) { v = std::bit_cast<float>(std::bit_cast<std::uint32_t>(v) ^ 1U); }
void nudge(bool& v) { v = !v; }
void nudge(rt::Time& t) { t += rt::Nanos{1}; }
template <class T>
requires std::is_integral_v<T>
void nudge(T& v) { v = static_cast<T>(v ^ 1); }
template <class T>
requires std::is_enum_v<T>
void nudge(T& v) { v = static_cast<T>(static_cast<std::underlying_type_t<T>>(v) ^ 1); }

template <class M>
using Changes = std::vector<std::function<void(M&)>>;

template <class M>
void expect_each_seen(const M& base, const Changes<M>& changes) {
  const std::uint64_t before = digest(base);
  EXPECT_EQ(before, digest(base));
  auto m = std::make_unique<M>();
  std::vector<std::uint64_t> seen{before};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    *m = base;
    changes[i](*m);
    const std::uint64_t now = digest(*m);
    for (const std::uint64_t other : seen) EXPECT_NE(now, other) << "change " << i;
    seen.push_back(now);
  }
}

#define FIELD(path) [](auto& m) { nudge(m.path); }
#define VEC3(path) FIELD(path(0)), FIELD(path(1)), FIELD(path(2))

TEST(OutputHash, TheForce) {
  expect_each_seen<tasks::Vec3>(
      {1, 2, 3},
      {[](auto& v) { nudge(v(0)); }, [](auto& v) { nudge(v(1)); }, [](auto& v) { nudge(v(2)); }});
}

TEST(OutputHash, HandAndTouch) {
  expect_each_seen<tasks::HapticState>(
      {}, {FIELD(seq), FIELD(stamp), VEC3(p_WH), VEC3(v_WH), VEC3(p_WP), VEC3(f_H_W),
           VEC3(normal_W), FIELD(contacts), FIELD(button), FIELD(patch_seq)});
  expect_each_seen<tasks::TouchEvent>(
      {}, {FIELD(seq), FIELD(stamp), FIELD(kind), VEC3(p_W), VEC3(normal_W), FIELD(force_N)});
}

TEST(OutputHash, CameraPathTaskAndMode) {
  expect_each_seen<tasks::CameraPose>(
      {}, {FIELD(seq), FIELD(exposure), FIELD(X_WC.matrix()(0, 1)), FIELD(X_WC.matrix()(2, 3)),
           FIELD(tracking), FIELD(claimed)});
  tasks::Path path;
  path.size = 2;
  expect_each_seen<tasks::Path>(
      path, {FIELD(seq), FIELD(made), FIELD(mark_seq), FIELD(mark_stamp), FIELD(size),
             FIELD(points[0][0]), FIELD(points[1][2]), VEC3(marked_W)});
  tasks::Path older = path;
  nudge(older.points[2][0]);
  EXPECT_EQ(digest(older), digest(path)) << "past the end of the path";
  expect_each_seen<tasks::OdometryFrame>(
      {},
      {FIELD(seq), FIELD(taken), FIELD(claimed), FIELD(X_WO[0]), FIELD(X_WO[2]),
       FIELD(covariance[0]), FIELD(covariance[5]), FIELD(error_m), FIELD(error_rad), FIELD(known),
       FIELD(follows_camera), FIELD(unsure), FIELD(held), FIELD(held_ms), FIELD(held_limit_ms)});
  expect_each_seen<tasks::TaskState>(
      {}, {FIELD(seq), FIELD(stamp), FIELD(phase), FIELD(marks), FIELD(paths), FIELD(failures),
           FIELD(off_m), FIELD(is_short), FIELD(failure)});
  expect_each_seen<tasks::ModeMsg>(
      {}, {FIELD(seq), FIELD(stamp), FIELD(mode), FIELD(cause), FIELD(clear), FIELD(resumes)});
}

TEST(OutputHash, Objects) {
  auto list = std::make_unique<tasks::ObjectList>();
  list->size = 2;
  expect_each_seen<tasks::ObjectList>(
      *list,
      {FIELD(seq), FIELD(exposure), FIELD(size), FIELD(mark_seq), FIELD(answer), FIELD(touched),
       FIELD(entries[0].id), FIELD(entries[1].serial), FIELD(entries[0].seen),
       FIELD(entries[1].summarised), FIELD(entries[0].X_WO.matrix()(0, 3)),
       FIELD(entries[1].X_WO.matrix()(2, 1)), VEC3(entries[0].extent_m), VEC3(entries[1].centre_m),
       FIELD(entries[0].colour.r), FIELD(entries[1].colour.g), FIELD(entries[1].colour.b)});
  const std::uint64_t before = digest(*list);
  nudge(list->entries[2].serial);
  EXPECT_EQ(digest(*list), before) << "past the end of the list";
}

TEST(OutputHash, RobotGoalStateAndSetpoints) {
  expect_each_seen<drivers::RobotGoal>(
      {}, {FIELD(seq), FIELD(made), FIELD(valid_until), FIELD(x_m), FIELD(y_m), FIELD(yaw_rad),
           FIELD(vx), FIELD(vy), FIELD(wz), FIELD(speed_limit_m_per_s), FIELD(engaged),
           FIELD(operator_engaged), FIELD(operator_clear), FIELD(path_seq)});
  expect_each_seen<drivers::RobotState>(
      {}, {FIELD(seq), FIELD(made), FIELD(taken), FIELD(x_m), FIELD(y_m), FIELD(yaw_rad), FIELD(vx), FIELD(vy),
           FIELD(wz), FIELD(cmd_vx), FIELD(cmd_vy), FIELD(cmd_wz), FIELD(goal_seq), FIELD(mode),
           FIELD(moving), FIELD(fault), FIELD(pauses), FIELD(mode_cause)});
  expect_each_seen<drivers::MotorSetpoints>(
      {}, {FIELD(mode), FIELD(wheel_rad_per_s[0]), FIELD(wheel_rad_per_s[3])});
}

TEST(OutputHash, Frame) {
  auto frame = std::make_unique<drivers::EncodedFrame>();
  frame->depth_size = 10;
  frame->colour_size = 7;
  expect_each_seen<drivers::EncodedFrame>(
      *frame, {FIELD(exposure.ns), FIELD(exposure.box), FIELD(seq), FIELD(intrinsics.fx),
               FIELD(intrinsics.height), FIELD(has_colour), FIELD(depth_size), FIELD(bytes[0]),
               FIELD(bytes[16])});
  const std::uint64_t before = digest(*frame);
  frame->bytes[17] = 1;
  EXPECT_EQ(digest(*frame), before) << "past the end of the picture";
}

// A voxel: with the writer's checksum, and where it made none.
TEST(OutputHash, Patch) {
  auto patch = std::make_unique<perception::SurfacePatch>();
  patch->nodes = 8;
  patch->checksum = perception::patch_checksum(*patch);
  using Patch = perception::SurfacePatch;
  expect_each_seen<Patch>(
      *patch, {FIELD(map_id), FIELD(seq), FIELD(fused), FIELD(exposure), FIELD(voxel_size),
               FIELD(metres_per_unit), FIELD(nodes), FIELD(checksum), FIELD(origin_node[1]),
               FIELD(palette[0].stiffness_scale), FIELD(palette[15].texture_period_m)});
  for (const bool checksums : {true, false}) {
    const auto sum = [checksums](Patch& p) {
      p.checksum = checksums ? perception::patch_checksum(p) : 0;
    };
    sum(*patch);
    expect_each_seen<Patch>(*patch, {[&](Patch& p) { nudge(p.distance[0]), sum(p); },
                                     [&](Patch& p) { nudge(p.distance[511]), sum(p); },
                                     [&](Patch& p) { nudge(p.material[77]), sum(p); },
                                     [&](Patch& p) { nudge(p.free[7]), sum(p); }});
    const std::uint64_t before = digest(*patch);
    patch->distance[512] ^= 1;
    sum(*patch);
    EXPECT_EQ(digest(*patch), before) << "outside of the window";
  }
}

TEST(OutputHash, ViewAndCostMap) {
  auto view = std::make_unique<tasks::SceneView>();
  view->intrinsics = {200, 200, 4, 3, 8, 6};
  expect_each_seen<tasks::SceneView>(
      *view, {FIELD(seq), FIELD(fused), FIELD(exposure), FIELD(X_WV.matrix()(1, 3)),
              FIELD(intrinsics.cx), FIELD(colour[0].g), FIELD(colour[47].b), FIELD(points[3].depth),
              FIELD(points[47].x), FIELD(object[0]), FIELD(object[47])});
  const std::uint64_t before = digest(*view);
  nudge(view->points[48].x);
  EXPECT_EQ(digest(*view), before) << "outside of the picture";

  auto map = std::make_unique<perception::CostMap>();
  map->width = 9;
  map->height = 5;
  expect_each_seen<perception::CostMap>(
      *map, {FIELD(seq), FIELD(fused), FIELD(exposure), FIELD(ground_found), FIELD(resolution),
             FIELD(width), FIELD(height), FIELD(X_WM.matrix()(0, 0)), FIELD(cost[44]),
             FIELD(height_m[44])});
}

TEST(OutputHash, SurfacePoints) {
  tasks::SurfacePoints points;
  points.resize(37);
  expect_each_seen<tasks::SurfacePoints>(
      points, {FIELD(seq), FIELD(fused), FIELD(exposure), FIELD(X_WC.matrix()(1, 3)), FIELD(count),
               FIELD(x[0]), FIELD(x[36]), FIELD(y[5]), FIELD(z[36]), FIELD(nx[1]), FIELD(ny[36]),
               FIELD(nz[0])});
  const std::uint64_t before = digest(points);
  nudge(points.x[37]);
  nudge(points.nz[47]);
  EXPECT_EQ(digest(points), before) << "padding";
}

TEST(OutputHash, MeshDelta) {
  using Delta = perception::MeshDelta;
  auto delta = std::make_unique<Delta>();
  delta->block_count = 2;
  delta->vertex_count = 5;
  delta->triangle_count = 3;
  expect_each_seen<Delta>(
      *delta, {FIELD(seq), FIELD(fused), FIELD(exposure), FIELD(restart), FIELD(block_count),
               FIELD(vertex_count), FIELD(triangle_count), FIELD(blocks[1].at.z),
               FIELD(blocks[0].version), FIELD(blocks[1].vertices), FIELD(blocks[1].triangles),
               FIELD(vertices[4].y), FIELD(vertices[0].colour.b), FIELD(triangles[2][1])});
  const std::uint64_t before = digest(*delta);
  nudge(delta->vertices[5].x);
  nudge(delta->triangles[3][0]);
  nudge(delta->blocks[2].version);
  EXPECT_EQ(digest(*delta), before) << "behind the message";
}

#undef VEC3
#undef FIELD

}  // namespace
