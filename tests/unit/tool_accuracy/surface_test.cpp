// The measures of a surface, against figures known beforehand.
#include "tools/measure/accuracy/surface_error.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rt/random.hpp"
#include "tests/unit/tool_accuracy/ghost_volume.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {
namespace {

using perception::Pose;
using perception::Vec3;

drivers::WorldConfig floor_and_box() {
  drivers::WorldConfig w;
  auto& p = w.planes.emplace_back();
  p.name = "floor";
  auto& b = w.boxes.emplace_back();
  b.name = "box", b.size_m = {0.4, 0.4, 0.4}, b.position_m = {2.0, 0.0, 0.2};
  return w;
}

TEST(Surface, ErrorsAreThoseThatWerePutIn) {
  rt::Startup startup;
  const drivers::World world(startup.token(), floor_and_box());
  perception::Mesh mesh;
  rt::Random random(3);
  double squares = 0;
  for (int i = 0; i < 1000; ++i) {
    // 900 vertices 1 mm above the floor, 90 3 mm below it, 10 40 mm above.
    const double off = i < 900 ? 0.001 : i < 990 ? -0.003 : 0.040;
    squares += 1e6 * off * off;
    mesh.vertices_W.emplace_back(static_cast<float>(random.uniform()),
                                 static_cast<float>(random.uniform()), static_cast<float>(off));
  }
  const SurfaceError e = surface_error(mesh, world, {});
  EXPECT_EQ(e.vertices, 1000U);
  EXPECT_EQ(e.stray, 10U);
  EXPECT_NEAR(e.median_mm, 1, 1e-4);
  EXPECT_NEAR(e.p95_mm, 3, 1e-4);
  EXPECT_NEAR(e.max_mm, 40, 1e-4);
  EXPECT_NEAR(e.rmse_mm, std::sqrt(squares / 1000), 1e-4);
}

TEST(Surface, CompletenessIsOfWhatTheFramesSee) {
  rt::Startup startup;
  const drivers::World world(startup.token(), floor_and_box());
  const perception::Intrinsics k{100, 100, 63.5, 63.5, 128, 128};
  const std::vector<Pose> poses(5, looking(Vec3(0, 0, 1), 0, 0.5));
  const auto seen = seen_surface(world, k, poses);
  ASSERT_GT(seen.size(), 100U);
  for (const Vec3& p : seen) {
    EXPECT_LT(std::abs(world.signed_distance(p)), 1e-9);
    EXPECT_FALSE(p.x() > 1.81 && p.x() < 2.19 && std::abs(p.y()) < 0.19 && p.z() < 0.39)
        << "inside";
    const Vec3 q = poses[0].inverse() * p;
    EXPECT_GE(q.z(), 0.4);
    EXPECT_LE(q.z(), 3.5);
    EXPECT_GT(world.ray_cast(poses[0].translation(), p - poses[0].translation()).t, 1 - 1e-6)
        << "hidden";
  }
  EXPECT_TRUE(seen_surface(world, k, std::span(poses).first(4)).empty()) << "four frames: too few";
  // Vertices 5 mm off every second point.
  perception::Mesh mesh;
  std::size_t covered = 0;
  for (std::size_t i = 0; i < seen.size(); i += 2) {
    mesh.vertices_W.push_back((seen[i] + Vec3(0, 0, 0.005)).cast<float>());
  }
  for (const Vec3& p : seen) {
    bool near = false;
    for (const auto& v : mesh.vertices_W) near = near || (v.cast<double>() - p).norm() <= 0.01;
    covered += near ? 1 : 0;
  }
  EXPECT_NEAR(surface_error(mesh, world, seen).completeness,
              static_cast<double>(covered) / static_cast<double>(seen.size()), 1e-12);
}

TEST(Surface, GhostIsWhatStandsWhereTheBoxWas) {
  rt::Startup startup;
  drivers::WorldConfig config = floor_and_box();
  config.boxes.clear();
  const drivers::World now(startup.token(), config);
  Pose X_WB = Pose::Identity();
  X_WB.translation() = Vec3(2.0, 0.0, 0.2);
  const Vec3 half = Vec3::Constant(0.2);
  perception::Mesh mesh;
  const auto add = [&](double x, double y, double z) {
    mesh.vertices_W.emplace_back(static_cast<float>(x), static_cast<float>(y),
                                 static_cast<float>(z));
  };
  EXPECT_EQ(ghost_volume_cm3(mesh, now, X_WB, half), 0);
  add(2.0, 0.0, 0.025);  // near the floor
  add(1.0, 0.0, 0.205);  // elsewhere
  EXPECT_EQ(ghost_volume_cm3(mesh, now, X_WB, half), 0);
  add(1.805, 0.005, 0.205);
  add(1.806, 0.006, 0.207);  // the same cell
  add(1.755, 0.005, 0.205);  // within 50 mm of the box
  EXPECT_EQ(ghost_volume_cm3(mesh, now, X_WB, half), 2);
}

}  // namespace
}  // namespace teletact
