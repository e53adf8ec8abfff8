// The scene changes: what is gone is forgotten.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <tuple>

#include "perception/tsdf/mesh.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::coarse;
using tests::Rig;

double distance_to_surface(const AnalyticScene& scene, const Vec3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& plane : scene.planes)
    least = std::min(least, std::abs(plane.normal.dot(p - plane.point)));
  for (const auto& box : scene.boxes) {
    const Vec3 q = (box.X_WS.inverse() * p).cwiseAbs() - box.half;
    const double outside = q.cwiseMax(0).norm(), inside = std::min(q.maxCoeff(), 0.0);
    least = std::min(least, std::abs(outside + inside));
  }
  return least;
}

// Number of 10 mm cells, each 1 cm3, in the box grown by 50 mm that hold a vertex more than 30 mm off every
// true surface.
int ghost_cm3(Rig& rig, const AnalyticScene& now, const AnalyticScene::Box& gone) {
  const auto mesh = perception::extract_mesh(rig.startup.token(), rig.task->map());
  std::set<std::tuple<int, int, int>> cells;
  for (const auto& v : mesh.vertices_W) {
    const Vec3 p = v.cast<double>();
    const Vec3 local = (gone.X_WS.inverse() * p).cwiseAbs();
    if ((local - gone.half).maxCoeff() > 0.05 || distance_to_surface(now, p) <= 0.03) continue;
    const Eigen::Vector3i c = (p / 0.01).array().floor().cast<int>();
    cells.insert({c.x(), c.y(), c.z()});
  }
  return static_cast<int>(cells.size());
}

// A box of 0.3 x 0.3 x 0.4 m is there for 60 frames, and then it is not.
TEST(Changes, ABoxTakenAwayIsForgotten) {
  const AnalyticScene room = tests::test_room();
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(0.4, Vec3::UnitZ()).toRotationMatrix();
  X.translation() = Vec3(1.15, -0.35, 0.2);
  const AnalyticScene::Box box{X, Vec3(0.15, 0.15, 0.2)};
  AnalyticScene with = room;
  with.boxes.push_back(box);
  FusionConfig config = coarse();
  config.tsdf.voxel_size_m = 0.01;
  config.tsdf.max_blocks = 16384;
  Rig rig(config);
  const auto at = [](int i) {
    const double s = 0.02 * i;
    return tests::look_at(Vec3(-0.2 + 0.05 * std::sin(s), 0.1 + 0.1 * std::sin(1.3 * s), 0.9),
                          Vec3(1.6, -0.2, 0.3));
  };
  int claimed = 0;
  for (int i = 0; i < 60; ++i) {
    rig.see(with, at(i), 0.0015);
    claimed += rig.out.camera.claimed ? 1 : 0;
  }
  const int before = ghost_cm3(rig, room, box);
  EXPECT_GT(before, 200) << "the measure sees the box while it stands";
  for (int i = 60; i < 120; ++i) {
    rig.see(room, at(i), 0.0015);
    claimed += rig.out.camera.claimed ? 1 : 0;
    if (i == 89)
      std::printf("  %d frames after: ghost %d cm3\n", i - 59, ghost_cm3(rig, room, box));
  }
  EXPECT_EQ(claimed, 120);
  EXPECT_LE(ghost_cm3(rig, room, box), 45);
  EXPECT_LT((rig.out.camera.X_WC.translation() - at(119).translation()).norm(), 0.01);
}

}  // namespace
}  // namespace tasks
