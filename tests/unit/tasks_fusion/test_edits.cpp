// What the operator asks of the scene: regions that are forgotten, no-go areas; and the mesh that
// the console is told.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>

#include "perception/tsdf/mesh/mesh.hpp"
#include "tasks/fusion/drawn_obstacles.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using perception::MeshDelta;
using perception::VirtualObstacle;
using tests::AnalyticScene;
using tests::coarse;
using tests::Rig;
using Box = Eigen::AlignedBox3d;

std::size_t vertices_in(Rig& rig, const Box& box_W) {
  const auto mesh = perception::extract_mesh(rig.startup.token(), rig.task->map());
  std::size_t n = 0;
  for (const auto& v : mesh.vertices_W) n += box_W.contains(v.cast<double>()) ? 1 : 0;
  return n;
}

int cost_at(const Rig& rig, double x_W, double y_W) {
  const auto& m = *rig.cost;
  const Vec3 p = m.X_WM.inverse() * Vec3(x_W, y_W, 0) / m.resolution;
  return m.cost[m.index(static_cast<int>(std::floor(p.x())), static_cast<int>(std::floor(p.y())))];
}

// The large box of the room is taken away. Without an edit its ghost stays for as long as the
// weights hold; the operator's box forgets it at once, and the robot may drive there when its floor
// was seen.
TEST(SceneEdits, AClearedBoxIsForgottenAndItsFloorIsFree) {
  const AnalyticScene room = tests::test_room();
  AnalyticScene taken = room;
  ASSERT_NEAR(taken.boxes.front().X_WS.translation().x(), 1.7, 1e-9);
  taken.boxes.erase(taken.boxes.begin());
  // Its faces and top, above the floor's band.
  const Box ghost(Vec3(1.4, 0.15, 0.12), Vec3(2.0, 0.85, 0.45));
  std::size_t left[2] = {0, 0};
  for (const bool cleared : {false, true}) {
    Rig rig;
    for (int i = 0; i < 40; ++i) rig.see(room, Rig::eye(i / 4));
    ASSERT_GT(vertices_in(rig, ghost), 100U);
    ASSERT_EQ(cost_at(rig, 1.7, 0.5), perception::CostMap::kOccupied);
    if (cleared) rig.in.clear_W = Box(Vec3(1.35, 0.1, 0.02), Vec3(2.05, 0.9, 0.6));
    rig.see(taken, Rig::eye(10));
    EXPECT_TRUE(rig.out.camera.claimed);
    rig.in.clear_W.reset();
    EXPECT_FALSE(rig.task->clearing()) << "a box like this one takes one job";
    rig.see(taken, Rig::eye(10));
    left[cleared ? 1 : 0] = vertices_in(rig, ghost);
    for (int i = 0; i < 4; ++i) rig.see(taken, Rig::eye(10));
    const int cost = cost_at(rig, 1.7, 0.5);
    if (cleared) {
      EXPECT_NE(cost, perception::CostMap::kOccupied);
      EXPECT_NE(cost, perception::CostMap::kUnknown);
    }
    EXPECT_LT((rig.out.camera.X_WC.translation() - Rig::eye(10).translation()).norm(), 0.01);
  }
  std::printf("  vertices of the ghost two frames later: %zu; cleared: %zu\n", left[0], left[1]);
  EXPECT_GT(left[0], 100U);
  EXPECT_EQ(left[1], 0U);
}

// A large region goes in slabs: each job clears a bounded part, and in the end the map is what one
// call makes.
TEST(SceneEdits, ALargeRegionTakesSeveralJobsAndIsTheSameAsOne) {
  const AnalyticScene room = tests::test_room();
  const Box all(Vec3(-1.0, -2.0, -0.3), Vec3(4.0, 2.0, 2.4));
  Rig rig;
  for (int i = 0; i < 4; ++i) rig.see(room, Rig::eye(i));
  perception::TsdfMap& map = const_cast<perception::TsdfMap&>(rig.task->map());
  ASSERT_GT(map.block_count(), 500);
  rig.in.clear_W = all;
  int jobs = 0;
  int before = map.block_count();
  do {
    rig.step(false);  // no image: nothing is fused meanwhile
    rig.in.clear_W.reset();
    ++jobs;
    EXPECT_LE(map.block_count(), before);
    before = map.block_count();
  } while (rig.task->clearing() && jobs < 1000);
  std::printf("  %d jobs for 5 x 4 x 2.7 m of 20 mm\n", jobs);
  EXPECT_GT(jobs, 5);
  EXPECT_LT(jobs, 60);
  EXPECT_EQ(vertices_in(rig, all), 0U);
  const auto content = map.checksum();
  map.clear_region(all);
  EXPECT_EQ(map.checksum(), content) << "nothing was left for it";
}

TEST(SceneEdits, OnlyARegionThatIsOneCanBeCleared) {
  EXPECT_TRUE(FusionTask::clearable(Box(Vec3(0, 0, 0), Vec3(1, 1, 10))));
  EXPECT_FALSE(FusionTask::clearable(Box(Vec3(0, 0, 0), Vec3(1, 1, 10.1))));
  EXPECT_FALSE(FusionTask::clearable(Box()));
  EXPECT_FALSE(FusionTask::clearable(Box(Vec3(0, 0, 0), Vec3(1, -1, 1))));
  EXPECT_FALSE(FusionTask::clearable(Box(Vec3(0, std::nan(""), 0), Vec3(1, 1, 1))));
  EXPECT_FALSE(FusionTask::clearable(Box(Vec3(0, 0, 0), Vec3(1, INFINITY, 1))));
  Rig rig;
  rig.see(tests::test_room(), Rig::eye(0));
  const auto content = rig.task->map().checksum();
  rig.in.clear_W = Box(Vec3(0, 0, 0), Vec3(1, std::nan(""), 1));
  rig.step(false);
  EXPECT_FALSE(rig.task->clearing());
  EXPECT_EQ(rig.task->map().checksum(), content);
}

SceneEdit disc(std::uint16_t id, double x, double radius) {
  SceneEdit e;
  e.kind = SceneEdit::Kind::kDrawDisc;
  e.id = id;
  e.centre_W = {x, 0.2, 0};
  e.half_m[0] = radius;
  return e;
}

TEST(DrawnObstacles, AreReplacedByIdAndErasedWithoutTheScenesOwn) {
  perception::GroundConfig ground;
  ground.virtual_obstacles.emplace_back().radius_m = 0.33;
  DrawnObstacles drawn(ground);
  ASSERT_EQ(drawn.all().size(), 1U);
  EXPECT_TRUE(drawn.apply(disc(4, 1.0, 0.2)));
  EXPECT_TRUE(drawn.apply(disc(9, 2.0, 0.3)));
  EXPECT_TRUE(drawn.apply(disc(4, 1.5, 0.1))) << "moved";
  ASSERT_EQ(drawn.all().size(), 3U);
  EXPECT_EQ(drawn.all()[1].centre_W, Vec3(1.5, 0.2, 0));
  EXPECT_EQ(drawn.all()[1].radius_m, 0.1);
  SceneEdit box = disc(5, 0, 0.4);
  box.kind = SceneEdit::Kind::kDrawBox;
  EXPECT_FALSE(drawn.apply(box)) << "a box has two edges";
  box.half_m[1] = 0.7;
  box.yaw_rad = 0.5;
  EXPECT_TRUE(drawn.apply(box));
  EXPECT_EQ(drawn.all()[3].kind, VirtualObstacle::Kind::kBox);
  EXPECT_EQ(drawn.all()[3].half_x_m, 0.4);
  EXPECT_EQ(drawn.all()[3].half_y_m, 0.7);
  EXPECT_EQ(drawn.all()[3].yaw_rad, 0.5);
  SceneEdit erase;
  erase.kind = SceneEdit::Kind::kErase;
  erase.id = 77;
  EXPECT_FALSE(drawn.apply(erase)) << "there is none";
  erase.id = 4;
  EXPECT_TRUE(drawn.apply(erase));
  ASSERT_EQ(drawn.all().size(), 3U);
  EXPECT_EQ(drawn.all()[1].radius_m, 0.3) << "the others keep their order";
  erase.id = SceneEdit::kAll;
  EXPECT_TRUE(drawn.apply(erase));
  ASSERT_EQ(drawn.all().size(), 1U) << "the scene's own stays";
  EXPECT_EQ(drawn.all()[0].radius_m, 0.33);
}

TEST(DrawnObstacles, RefuseWhatIsNoneAndWhatHasNoRoom) {
  DrawnObstacles drawn{perception::GroundConfig{}};
  EXPECT_FALSE(drawn.apply(disc(0, 1, 0.2))) << "0 is nobody's";
  EXPECT_FALSE(drawn.apply(disc(1, 1, 0)));
  EXPECT_FALSE(drawn.apply(disc(1, 1, -1)));
  EXPECT_FALSE(drawn.apply(disc(1, 1, std::nan(""))));
  EXPECT_FALSE(drawn.apply(disc(1, 1, 101)));
  EXPECT_FALSE(drawn.apply(disc(1, std::nan(""), 0.2)));
  SceneEdit clear = disc(1, 1, 0.2);
  clear.kind = SceneEdit::Kind::kClear;
  EXPECT_FALSE(drawn.apply(clear));
  EXPECT_TRUE(drawn.all().empty());
  for (int id = 1; id <= perception::GroundMap::kMaxVirtual; ++id)
    EXPECT_TRUE(drawn.apply(disc(static_cast<std::uint16_t>(id), id, 0.1)));
  EXPECT_FALSE(drawn.apply(disc(1000, 1, 0.1)));
  EXPECT_TRUE(drawn.apply(disc(7, 1, 0.2))) << "one that is there can still be moved";
}

// ---------------------------------------------------------------- mesh

struct MeshRig : Rig {
  std::unique_ptr<MeshDelta> delta = std::make_unique<MeshDelta>();
  perception::MeshStore store;
  int messages = 0;
  explicit MeshRig(int blocks) : Rig(config(blocks)) { out.mesh = delta.get(); }
  static FusionConfig config(int blocks) {
    FusionConfig c = coarse();
    c.mesh_blocks = blocks;
    c.mesh_period_frames = 2;
    return c;
  }
  // A console that takes what it is told, or does not.
  void listen(bool takes = true) {
    if (!out.mesh_written) return;
    ++messages;
    if (takes && store.take(*delta)) in.mesh_taken = delta->seq;
  }
  void expect_whole() {
    perception::MeshOptions options;
    options.refined = false;
    const auto mesh = perception::extract_mesh(startup.token(), task->map(), options);
    EXPECT_GT(mesh.triangles.size(), 1000U);
    EXPECT_EQ(store.triangles(), mesh.triangles.size());
  }
};

TEST(MeshOfTheTask, IsToldInParts) {
  MeshRig rig(50);
  const AnalyticScene room = tests::test_room();
  for (int i = 0; i < 20; ++i) {
    rig.see(room, Rig::eye(i));
    EXPECT_TRUE(rig.out.camera.claimed);
    EXPECT_LE(rig.out.mesh_written ? rig.delta->block_count : 0, 50);
    rig.listen();
  }
  EXPECT_EQ(rig.messages, 9) << "every second period, but the first: nothing was seen twice yet";
  for (int i = 0; i < 400; ++i) {
    rig.step(false);
    rig.listen();
  }
  rig.expect_whole();
  const int told = rig.messages;
  rig.step(false);
  rig.step(false);
  rig.listen();
  EXPECT_EQ(rig.messages, told) << "a scene at rest has nothing to tell";
}

TEST(MeshOfTheTask, WaitsForAnAnswerAndBeginsAnewWithoutOne) {
  MeshRig rig(400);
  const AnalyticScene room = tests::test_room();
  for (int i = 0; i < 7; ++i) {
    rig.see(room, Rig::eye(i));
    EXPECT_EQ(rig.out.mesh_written, i >= 2 && i % 2 == 0) << i;
    EXPECT_EQ(rig.out.mesh_written && rig.delta->restart, i == 2) << i;
    rig.listen();
  }
  const int told = rig.messages;
  // The console is away: one more message, then nothing, then all of it again.
  int away = 0;
  bool restarted = false;
  for (int i = 7; i < 60 && !restarted; ++i) {
    rig.see(room, Rig::eye(6));
    if (!rig.out.mesh_written) continue;
    ++away;
    restarted = rig.delta->restart;
  }
  EXPECT_EQ(told, 3);
  EXPECT_EQ(away, 2);
  ASSERT_TRUE(restarted);
  rig.listen();  // back
  for (int i = 0; i < 200; ++i) {
    rig.step(false);
    rig.listen();
  }
  rig.expect_whole();
}

TEST(MeshOfTheTask, IsNotMadeUnlessAskedFor) {
  MeshRig rig(0);
  for (int i = 0; i < 6; ++i) {
    rig.see(tests::test_room(), Rig::eye(i));
    EXPECT_FALSE(rig.out.mesh_written);
  }
}

}  // namespace
}  // namespace tasks
