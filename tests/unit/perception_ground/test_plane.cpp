// Ground plane on noisy points with outliers; slanted cameras; refusals.
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <vector>

#include "perception/ground/ground_plane.hpp"
#include "rt/random.hpp"

namespace perception {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Floor points before a camera, outliers above it (furniture, walls) and a few below.
std::vector<Vec3f> floor_points(const Vec3& normal, double offset, double sigma, double outliers,
                                int n, rt::Random& random) {
  const Vec3 x = normal.unitOrthogonal(), y = normal.cross(x);
  std::vector<Vec3f> points;
  for (int i = 0; i < n; ++i) {
    Vec3 p = (offset + sigma * random.normal()) * normal + random.uniform(-2, 2) * x +
             random.uniform(-2, 2) * y;
    if (random.uniform() < outliers) p += random.uniform(0.05, 1.5) * normal;
    if (random.uniform() < 0.01) p -= random.uniform(0.2, 0.5) * normal;
    points.push_back(p.cast<float>());
  }
  return points;
}

TEST(GroundPlane, FoundAmongFortyPercentOutliers) {
  double worst_deg = 0, worst_mm = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    rt::Random random(seed);
    // A camera that leans up to 10 degrees against the plane's true normal.
    const Vec3 up = Vec3(0.1 * random.normal(), 0.1 * random.normal(), 1).normalized();
    const double offset = random.uniform(-0.3, 0.3);
    const auto points = floor_points(up, offset, 0.008, 0.4, 3000, random);
    const Vec3 camera = (offset + 0.9) * up;
    GroundHint hint;
    hint.up = Vec3::UnitZ();
    hint.up_known = true;
    GroundPlaneConfig config;
    config.up_tolerance_deg = 25;
    const auto plane = find_ground(points, camera, hint, config, seed);
    ASSERT_TRUE(plane) << "seed " << seed;
    worst_deg = std::max(worst_deg, std::acos(std::min(1.0, plane->normal.dot(up))) / kDegree);
    worst_mm = std::max(worst_mm, 1000 * std::abs(plane->height(camera) - 0.9));
    EXPECT_NEAR(plane->normal.norm(), 1, 1e-9);
  }
  std::cout << "40 % outliers, 8 mm noise: worst tilt " << worst_deg << " deg, height " << worst_mm
            << " mm\n";
  EXPECT_LT(worst_deg, 0.15);
  EXPECT_LT(worst_mm, 3.0);
}

TEST(GroundPlane, TheTableIsNotTheGround) {
  rt::Random random(4);
  std::vector<Vec3f> points;
  for (int i = 0; i < 3000; ++i) {  // a large table hides two thirds of the floor
    const double z = i % 3 != 0 ? 0.7 : 0.0;
    points.emplace_back(static_cast<float>(random.uniform(0, 2)),
                        static_cast<float>(random.uniform(-1, 1)),
                        static_cast<float>(z + 0.004 * random.normal()));
  }
  GroundHint hint;
  hint.up_known = true;
  const auto plane = find_ground(points, Vec3(0, 0, 1.4), hint, GroundPlaneConfig{}, 1);
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->offset, 0, 0.01);
  hint.camera_height_m = 1.4;
  EXPECT_TRUE(find_ground(points, Vec3(0, 0, 1.4), hint, GroundPlaneConfig{}, 1));
  hint.camera_height_m = 0.9;
  EXPECT_FALSE(find_ground(points, Vec3(0, 0, 1.4), hint, GroundPlaneConfig{}, 1))
      << "no plane at the height that is known";
}

TEST(GroundPlane, NoGroundIsNoGround) {
  rt::Random random(5);
  GroundHint hint;
  hint.up_known = true;
  EXPECT_FALSE(find_ground({}, Vec3::Zero(), hint, GroundPlaneConfig{}, 0));
  std::vector<Vec3f> wall, line, same(500, Vec3f(1, 0, 0)),
      nan(500, Vec3f::Constant(std::nanf("")));
  for (int i = 0; i < 2000; ++i) {
    wall.emplace_back(2.0F, static_cast<float>(random.uniform(-2, 2)),
                      static_cast<float>(random.uniform(0, 2)));
    line.emplace_back(static_cast<float>(random.uniform(0, 2)), 0.0F, 0.0F);
  }
  for (const auto* points : {&wall, &line, &same, &nan}) {
    EXPECT_FALSE(find_ground(*points, Vec3(0, 0, 1), hint, GroundPlaneConfig{}, 0));
  }
}

TEST(GroundPlane, SameStreamSamePlane) {
  rt::Random random(6);
  const auto points = floor_points(Vec3::UnitZ(), 0, 0.01, 0.4, 2000, random);
  GroundHint hint;
  hint.up_known = true;
  const auto a = find_ground(points, Vec3(0, 0, 1), hint, GroundPlaneConfig{}, 9);
  const auto b = find_ground(points, Vec3(0, 0, 1), hint, GroundPlaneConfig{}, 9);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->normal, b->normal);
  EXPECT_EQ(a->offset, b->offset);
}

}  // namespace
}  // namespace perception
