// What a message weighs in a run's hash, how it ages, what a fault plan's nan does to it, and its
// bytes on the wire: pinned, so that recordings and robots of an older build are still understood.
// A change here is a change of format.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>

#include "drivers/link/wire_body.hpp"
#include "tasks/edges/edge_faults.hpp"
#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/limits.hpp"

namespace tasks {
namespace {

constexpr rt::Nanos kOlder{7'000'003};

rt::Time at(std::int64_t ms) { return rt::time_from_ns(ms * 1'000'000); }
Vec3 vec(double x) { return {x, -x / 3, x * x}; }
Pose pose(double x) {
  Pose X = Pose::Identity();
  X.linear() << 0, -1, 0, 1, 0, 0, 0, 0, 1;  // exact on every machine
  X.translation() = vec(x);
  return X;
}
perception::Intrinsics lens() { return {10.5, 11.5, 3.25, 2.75, 4, 3}; }

template <class M>
std::uint64_t weight(const M& m) {
  rt::Hash64 h;
  hash_output(h, m);
  return h.digest();
}

struct Golden {
  std::uint64_t plain, aged, spoiled;
};

template <class M>
Golden weigh(M& m) {
  Golden g{};
  g.plain = weight(m);
  edge::age(m, kOlder);
  g.aged = weight(m);
  edge::spoil(m);
  g.spoiled = weight(m);
  return g;
}

template <class M>
void expect(M& m, const Golden& golden) {
  const Golden g = weigh(m);
  char text[96];
  std::snprintf(text, sizeof text, "{0x%016llx, 0x%016llx, 0x%016llx}",
                static_cast<unsigned long long>(g.plain), static_cast<unsigned long long>(g.aged),
                static_cast<unsigned long long>(g.spoiled));
  EXPECT_EQ(g.plain, golden.plain) << text;
  EXPECT_EQ(g.aged, golden.aged) << text;
  EXPECT_EQ(g.spoiled, golden.spoiled) << text;
}

drivers::RobotState robot_state() {
  drivers::RobotState m;
  m.seq = 11, m.made = at(1210), m.taken = at(1200);
  m.x_m = 1.5, m.y_m = -2.25, m.yaw_rad = 0.125, m.vx = 0.5, m.vy = -0.25, m.wz = 0.75;
  m.cmd_vx = 0.625, m.cmd_vy = -0.375, m.cmd_wz = 0.875;
  m.goal_seq = 9, m.mode = 2, m.moving = 1, m.fault = 590, m.pauses = 2, m.mode_cause = 503;
  return m;
}
drivers::RobotGoal robot_goal() {
  drivers::RobotGoal m;
  m.seq = 12, m.made = at(1300), m.valid_until = at(1550);
  m.x_m = 2.5, m.y_m = -1.25, m.yaw_rad = 0.25, m.vx = 0.375, m.vy = -0.5, m.wz = 0.0625;
  m.speed_limit_m_per_s = 0.5;
  m.engaged = 1, m.operator_engaged = 1, m.operator_clear = 0, m.path_seq = 4;
  return m;
}

TEST(MessageGolden, Link) {
  auto state = robot_state();
  expect(state, {0x3b0a164840b88520, 0x6d22fb2990149efa, 0x71af7b8f381c9966});
  auto goal = robot_goal();
  expect(goal, {0x96e0e574dba08699, 0x5ee451cf8c069f7a, 0x5f5916f42b89d8a8});
  drivers::FrameDemand demand{13, at(1400), 8000, 2, 1};
  EXPECT_EQ(edge::datum(demand), at(1400));
  expect(demand, {0x930a916aac141e69, 0x3a486dc27a069aa6, 0x3a486dc27a069aa6});
  EXPECT_EQ(edge::datum(robot_state()), at(1200));
  EXPECT_EQ(edge::datum(robot_goal()), at(1300));
}

template <class M>
std::string bytes_of(const M& m) {
  std::array<std::uint8_t, drivers::kMaxControlBody> room{};
  const std::size_t n = drivers::encode(m, room);
  std::string text;
  for (std::size_t i = 0; i < n; ++i) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", room[i]);
    text += two;
  }
  return text;
}

TEST(MessageGolden, Wire) {
  EXPECT_EQ(drivers::schema_hash(), 0xfadeffd16711d37cU);
  // With frames coded on demand both ends say so, and how.
  EXPECT_EQ(drivers::schema_hash("depth quiet, colour jpeg"), 0x83aa7bfd4ba6f546U);
  EXPECT_NE(drivers::schema_hash("depth quiet, colour jpeg"),
            drivers::schema_hash("depth moving, colour jpeg"));
  EXPECT_EQ(bytes_of(drivers::FrameReport{0x1122334455, 1}), "554433221100000001");
  EXPECT_EQ(bytes_of(robot_state()),
            "0b0000000000000080221f4800000000008c864700000000000000000000f83f00000000000002c0000000"
            "000000c03f000000000000e03f000000000000d0bf000000000000e83f000000000000e43f000000000000"
            "d8bf000000000000ec3f090000000000000002014e0202f701");
  EXPECT_EQ(
      bytes_of(robot_goal()),
      "0c00000000000000006d7c4d00000000801f635c000000000000000000000440000000000000f4bf000000000000"
      "d03f000000000000d83f000000000000e0bf000000000000b03f000000000000e03f0101000400000000000000");
  EXPECT_EQ(bytes_of(drivers::ClockRequest{0x1122334455}), "5544332211000000");
  EXPECT_EQ(bytes_of(drivers::ClockReply{0x1122334455, 0x66778899, 0x77889900}),
            "554433221100000099887766000000000099887700000000");
}

// What the message of a further edge is written and read by gives the same bytes.
TEST(MessageGolden, WireByTheSchemasTemplate) {
  std::array<std::uint8_t, drivers::kMaxControlBody> room{}, other{};
  const std::size_t n = drivers::encode<drivers::RobotState>(robot_state(), room);
  EXPECT_EQ(n, drivers::encode(robot_state(), other));
  EXPECT_EQ(room, other);
  drivers::RobotState back;
  ASSERT_TRUE(drivers::decode<drivers::RobotState>(std::span(room).first(n), back));
  EXPECT_EQ(bytes_of(back), bytes_of(robot_state()));
  EXPECT_FALSE(drivers::decode<drivers::RobotState>(std::span(room).first(n - 1), back));
}

TEST(MessageGolden, HandAndTouch) {
  HapticState hand;
  hand.seq = 21, hand.stamp = at(2100);
  hand.p_WH = vec(0.1), hand.v_WH = vec(0.2), hand.p_WP = vec(0.3), hand.f_H_W = vec(4);
  hand.normal_W = vec(0.5), hand.contacts = 2, hand.button = true, hand.patch_seq = 6;
  hand.mark_seq = 3, hand.p_mark_W = vec(0.7);
  EXPECT_EQ(edge::datum(hand), at(2100));
  expect(hand, {0xa99d2406f2517db9, 0x8ef5637b1c729d58, 0xdf89f7345268410e});
  TouchEvent touch;
  touch.seq = 22, touch.stamp = at(2200), touch.kind = TouchEvent::Kind::kMarkPoint;
  touch.gap = true, touch.p_W = vec(0.8), touch.normal_W = vec(0.9), touch.force_N = 3.5;
  expect(touch, {0x97b7aa1b94b0bb51, 0xba3ae5f1b0a77237, 0xab4798def2b29162});
}

TEST(MessageGolden, PoseAndFrame) {
  CameraPose camera;
  camera.seq = 31, camera.exposure = at(3100), camera.X_WC = pose(1.5);
  camera.tracking = CameraPose::Tracking::kWeak, camera.claimed = true, camera.seen = at(3050);
  EXPECT_EQ(edge::datum(camera), at(3050));
  expect(camera, {0x34687655b0ff443f, 0x6d5ee0b9a5bac571, 0x44c1f9df7599e0a3});
  OdometryFrame frame;
  frame.seq = 32, frame.taken = at(3200), frame.claimed = at(3150);
  frame.X_WO = {1, 2, 0.5}, frame.covariance = {1, 0.1, 0.2, 2, 0.3, 3};
  frame.error_m = 0.02, frame.error_rad = 0.03;
  frame.known = frame.follows_camera = true;
  frame.held = Held::kSettling, frame.held_ms = 250, frame.held_limit_ms = 180;
  EXPECT_EQ(edge::datum(frame), at(3200));
  expect(frame, {0x58e256b313835843, 0x4b09fb89f5012731, 0xea6962450d39a296});
}

TEST(MessageGolden, Plan) {
  Path path;
  path.seq = 41, path.made = at(4100), path.mark_seq = 5, path.mark_stamp = at(4000);
  path.size = 2, path.points[0] = {0.5, 0.25, 1}, path.points[1] = {1.5, 1.25, 2};
  path.marked_W = vec(1.25), path.seen = at(4050);
  EXPECT_EQ(edge::datum(path), at(4050));
  expect(path, {0x5d652bb1caee47da, 0x9c93caaeed4d7b21, 0x1c94158e442a6c0c});
  TaskState task;
  task.seq = 42, task.stamp = at(4200), task.phase = TaskState::Phase::kDriving;
  task.marks = 3, task.paths = 2, task.failures = 1;
  task.off_m = 0.375, task.is_short = true, task.failure = TaskState::Failure::kNoWay;
  EXPECT_EQ(edge::datum(task), at(4200));
  expect(task, {0x663cd186f820d8ea, 0x2efaacea9a84af10, 0x2efaacea9a84af10});
  ModeMsg mode;
  mode.seq = 43, mode.stamp = at(4300), mode.mode = Mode::kEngaged, mode.cause = 190;
  mode.clear = mode.resumes = true;
  EXPECT_EQ(edge::datum(mode), at(4300));
  expect(mode, {0xc464a47a181d4cac, 0x35e6170faaaf0a8b, 0x35e6170faaaf0a8b});
}

TEST(MessageGolden, Patch) {
  auto patch = std::make_unique<perception::SurfacePatch>();
  patch->map_id = 2, patch->seq = 51, patch->fused = at(5100), patch->exposure = at(5050);
  patch->voxel_size = 0.01, patch->metres_per_unit = 0.0001F, patch->origin_node = {4, -5, 6};
  patch->nodes = 8, patch->checksum = 0x1234, patch->touched_moves = true;
  patch->palette[1].stiffness_scale = 0.5F;
  EXPECT_EQ(edge::datum(*patch), at(5050));
  expect(*patch, {0x50d2a06bffa2ae67, 0xb93369d402674c85, 0x91671a185f242f1b});
  SurfacePoints surface;
  surface.seq = 52, surface.fused = at(5200), surface.exposure = at(5150), surface.X_WC = pose(2);
  surface.resize(3);
  for (std::size_t i = 0; i < 3; ++i)
    surface.set(i, vec(0.5 + static_cast<double>(i)), vec(1.5 + static_cast<double>(i)));
  EXPECT_EQ(edge::datum(surface), at(5150));
  expect(surface, {0x0793e577707305a0, 0x574f7ac26193dadb, 0x65d10ba7e793ac50});
}

TEST(MessageGolden, View) {
  auto view = std::make_unique<SceneView>();
  view->seq = 61, view->fused = at(6100), view->exposure = at(6050), view->X_WV = pose(0.75);
  view->intrinsics = lens();
  for (std::size_t i = 0; i < 12; ++i) {
    view->colour[i] = {static_cast<std::uint8_t>(i), 7, 9};
    view->points[i] = {0.5F * static_cast<float>(i), 1, 2, 3};
    view->object[i] = static_cast<std::uint8_t>(i % 3), view->what[i] = 1;
  }
  view->masked = true;
  EXPECT_EQ(edge::datum(*view), at(6050));
  expect(*view, {0xdb14e7835a17aa84, 0x79c2fa28944546b8, 0xb59711782eec2b5b});
  auto mesh = std::make_unique<perception::MeshDelta>();
  mesh->seq = 62, mesh->fused = at(6200), mesh->exposure = at(6150), mesh->restart = true;
  mesh->block_count = 1, mesh->vertex_count = 3, mesh->triangle_count = 1;
  mesh->blocks[0].version = 4;
  mesh->vertices[1].x = 0.5F;
  EXPECT_EQ(edge::datum(*mesh), at(6150));
  expect(*mesh, {0xcf8ba6ac66f80429, 0x9983d3e18b3c60ee, 0x7c888b9304ebc203});
}

TEST(MessageGolden, GroundAndObjects) {
  auto map = std::make_unique<perception::CostMap>();
  map->seq = 71, map->fused = at(7100), map->exposure = at(7050), map->ground_found = true;
  map->resolution = 0.05, map->width = 3, map->height = 2, map->X_WM = pose(0.25);
  for (std::size_t i = 0; i < 6; ++i) map->cost[i] = static_cast<std::uint8_t>(i * 7);
  EXPECT_EQ(edge::datum(*map), at(7050));
  expect(*map, {0xc9a4f04eeb0f69ab, 0x7b11191654b09b4c, 0xd40b5e174f6ac0b8});
  auto list = std::make_unique<ObjectList>();
  list->seq = 72, list->exposure = at(7150), list->size = 1, list->mark_seq = 3, list->touched = 1;
  list->entries[0].id = 1, list->entries[0].serial = 5, list->entries[0].seen = true;
  list->entries[0].X_WO = pose(0.5), list->entries[0].extent_m = vec(0.3);
  EXPECT_EQ(edge::datum(*list), at(7150));
  expect(*list, {0xcda9e3028afefc60, 0x64b5be03345539e5, 0x095cfdaf8a8e3235});
}

TEST(MessageGolden, Instants) {
  auto frame = std::make_unique<perception::RgbdFrame>();
  frame->exposure = at(8100);
  EXPECT_EQ(edge::datum(*frame), at(8100));
  edge::age(*frame, kOlder);
  EXPECT_EQ(frame->exposure, at(8100) - kOlder);
  SceneEdit edit;
  edit.stamp = at(8200);
  edge::age(edit, kOlder);
  EXPECT_EQ(edit.stamp, at(8200) - kOlder);
  edge::spoil(edit);
  EXPECT_TRUE(std::isnan(edit.centre_W[2]) && std::isnan(edit.half_m[0]) &&
              std::isnan(edit.yaw_rad));
  OperatorAct act;
  act.stamp = at(8300);
  edge::age(act, kOlder);
  EXPECT_EQ(act.stamp, at(8300) - kOlder);
  edge::spoil(act);
  EXPECT_TRUE(std::isnan(act.p_W.x()) && std::isnan(act.normal_W.z()) && std::isnan(act.yaw_rad));
  DriveIntent drive{1, at(8400), true, 0.1, 0.2, 0.3};
  EXPECT_EQ(edge::datum(drive), at(8400));
  edge::spoil(drive);
  EXPECT_TRUE(std::isnan(drive.vx) && std::isnan(drive.vy) && std::isnan(drive.wz));
}

}  // namespace
}  // namespace tasks
