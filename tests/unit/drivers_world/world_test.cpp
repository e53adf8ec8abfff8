// The analytic world against slow references: sphere tracing of its own distance field, and closed
// forms.
#include "drivers/world/world.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/unit/drivers_world/nearest_shape.hpp"
#include "tests/unit/drivers_world/random_world.hpp"

namespace tests {
namespace {

using drivers::Shape;

// Slow reference: step by the distance to the nearest solid until it is gone.
double march(const World& w, const Vec3& o, const Vec3& d) {
  double t = 0;
  for (int i = 0; i < 100000 && t < 50; ++i) {
    const double s = w.signed_distance(o + t * d);
    if (s < 1e-9) return t;
    t += s;
  }
  return -1;
}

TEST(World, RayCastEqualsMarchingOfTheDistanceField) {
  int compared = 0, grazing = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    rt::Random rng(seed);
    const World w = make(random_world(rng, 5));
    for (int i = 0; i < 500; ++i) {
      const Vec3 o = free_point(w, rng), d = random_direction(rng);
      const auto hit = w.ray_cast(o, d);
      ASSERT_TRUE(hit);  // a closed room
      const double t = march(w, o, d);
      // Marching stops before a silhouette it passes within its own tolerance; such rays pass
      // almost along a surface. They are counted and must stay rare.
      if (std::abs(t - hit.t) > 1e-6 * (1 + hit.t) &&
          std::abs(w.signed_distance(o + t * d)) < 1e-8 && t < hit.t) {
        ++grazing;
        continue;
      }
      ++compared;
      const double slack = 1e-7 / std::max(0.01, -hit.normal_W.dot(d));
      ASSERT_NEAR(t, hit.t, slack + 1e-7);
      ASSERT_NEAR(w.signed_distance(o + hit.t * d), 0, 1e-9);
      ASSERT_EQ(nearest_shape(w, o + hit.t * d), hit.shape);
    }
  }
  EXPECT_GT(compared, 9990);
  EXPECT_LE(grazing, 10);
}

TEST(World, NormalIsTheGradientAndFacesTheRay) {
  rt::Random rng(7);
  const World w = make(random_world(rng, 5));
  int smooth = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 o = free_point(w, rng), d = random_direction(rng);
    const auto hit = w.ray_cast(o, d);
    ASSERT_TRUE(hit);
    ASSERT_NEAR(hit.normal_W.norm(), 1, 1e-9);
    ASSERT_LT(hit.normal_W.dot(d), 1e-9);
    const Vec3 p = o + hit.t * d + 1e-4 * hit.normal_W;
    Vec3 g;
    for (int a = 0; a < 3; ++a) {
      const Vec3 e = 1e-6 * Vec3::Unit(a);
      g[a] = (w.signed_distance(p + e, hit.shape) - w.signed_distance(p - e, hit.shape)) / 2e-6;
    }
    if ((g - hit.normal_W).norm() < 1e-3) ++smooth;
  }
  EXPECT_GT(smooth, 1990);  // all but hits on an edge
}

TEST(World, DirectionNeedNotHaveLengthOne) {
  rt::Random rng(8);
  const World w = make(random_world(rng, 4));
  for (int i = 0; i < 500; ++i) {
    const Vec3 o = free_point(w, rng), d = random_direction(rng);
    const double k = rng.uniform(0.1, 5);
    const auto a = w.ray_cast(o, d), b = w.ray_cast(o, k * d);
    ASSERT_EQ(a.shape, b.shape);
    ASSERT_NEAR(a.t, k * b.t, 1e-9 * (1 + a.t));
  }
}

TEST(World, ClosedForms) {
  WorldConfig c;
  c.planes.emplace_back().name = "ground";
  c.planes.back().ground = true;
  auto& b = c.boxes.emplace_back();
  b.name = "b", b.size_m = {0.2, 0.4, 0.6}, b.position_m = {1, 0, 0.3};
  auto& s = c.spheres.emplace_back();
  s.name = "s", s.position_m = {0, 3, 1}, s.radius_m = 0.5;
  auto& y = c.cylinders.emplace_back();
  y.name = "y", y.position_m = {0, -2, 0}, y.radius_m = 0.25, y.height_m = 1;
  const World w = make(c);
  EXPECT_DOUBLE_EQ(w.ray_cast({0, 0, 0.3}, {1, 0, 0}).t, 0.9);
  EXPECT_DOUBLE_EQ(w.ray_cast({0, 0, 1}, {0, 1, 0}).t, 2.5);
  EXPECT_DOUBLE_EQ(w.ray_cast({0, 0, 0.5}, {0, -1, 0}).t, 1.75);
  EXPECT_DOUBLE_EQ(w.ray_cast({0, -2, 3}, {0, 0, -1}).t, 2);  // down onto the cylinder's cap
  EXPECT_DOUBLE_EQ(w.ray_cast({0.1, -2, 3}, {0, 0, -2}).t, 1);
  EXPECT_DOUBLE_EQ(w.ray_cast({5, 5, 2}, {0, 0, -1}).t, 2);
  EXPECT_FALSE(w.ray_cast({5, 5, 2}, {0, 0, 1}));           // open sky
  EXPECT_FALSE(w.ray_cast({5, 5, 2}, {1, 0, 0}));           // parallel to the ground
  EXPECT_EQ(w.ray_cast({5, 5, -1}, {0, 0, 1}).shape, -1);   // from inside the ground
  EXPECT_EQ(w.ray_cast({1, 0, 0.3}, {1, 0, 0}).shape, -1);  // from inside the box: not seen
  // A ray in a face's own plane, and one along an edge: no NaN, no crash.
  (void)w.ray_cast({0, 0.2, 0.6}, {1, 0, 0});
  EXPECT_TRUE(std::isfinite(w.ray_cast({0, 0.2, 0.6}, {1, 0, 0}).t));
  EXPECT_FALSE(w.ray_cast({0, 0, 0.3}, Vec3::Zero()));
  EXPECT_DOUBLE_EQ(w.signed_distance({1, 0, 1.6}), 1.0);
  EXPECT_NEAR(w.signed_distance({1, 0, 0.3}), -0.1, 1e-15);
  EXPECT_DOUBLE_EQ(w.signed_distance({0, -2, 0.5}), -0.25);
  EXPECT_DOUBLE_EQ(w.signed_distance(Vec3(0, -2 + 0.25 + 0.3, 1.4)), 0.5);  // off the cap's rim
}

TEST(World, ACapsulesClosedForms) {
  WorldConfig c;
  auto& r = c.capsules.emplace_back();
  r.name = "rod", r.from_m = {1, -0.5, 2}, r.to_m = {1, 0.5, 2}, r.radius_m = 0.25;
  const World w = make(c);
  EXPECT_NEAR(w.signed_distance({2, 0.3, 2}), 0.75, 1e-12);    // beside
  EXPECT_NEAR(w.signed_distance({1, 1.5, 2}), 0.75, 1e-12);    // beyond an end
  EXPECT_NEAR(w.signed_distance({1, 0.1, 2}), -0.25, 1e-12);   // on the axis
  EXPECT_NEAR(w.signed_distance({1.3, 0.9, 2}), 0.25, 1e-12);  // 3-4-5 from an end
  auto hit = w.ray_cast({-1, 0.4, 2}, {2, 0, 0});              // side on
  EXPECT_NEAR(hit.t, (2 - 0.25) / 2, 1e-12);
  EXPECT_LT((hit.normal_W - Vec3(-1, 0, 0)).norm(), 1e-12);
  hit = w.ray_cast({1, -3, 2}, {0, 1, 0});  // along the axis
  EXPECT_NEAR(hit.t, 2.25, 1e-12);
  EXPECT_LT((hit.normal_W - Vec3(0, -1, 0)).norm(), 1e-12);
  EXPECT_FALSE(w.ray_cast({1, 0, 2}, {1, 0, 0}));      // from inside it is not seen
  EXPECT_FALSE(w.ray_cast({1, 0.8, 2}, {0, 1, 0}));    // it lies behind
  EXPECT_FALSE(w.ray_cast({-1, 0.76, 2}, {1, 0, 0}));  // past the round end
  EXPECT_TRUE(w.ray_cast({-1, 0.74, 2}, {1, 0, 0}));
}

TEST(World, EmptyWorld) {
  const World w = make({});
  EXPECT_TRUE(std::isinf(w.signed_distance({0, 0, 0})));
  EXPECT_FALSE(w.ray_cast({0, 0, 0}, {1, 0, 0}));
  EXPECT_EQ(w.robot_collision(0, 0, 0), -1);
  EXPECT_EQ(nearest_shape(w, {0, 0, 0}), -1);
}

TEST(World, BadShapesAreRefusedByName) {
  const auto message = [](const WorldConfig& c) -> std::string {
    try {
      (void)make(c);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  WorldConfig twice;
  twice.boxes.emplace_back().name = "crate";
  twice.spheres.emplace_back().name = "crate";
  EXPECT_NE(message(twice).find("'crate'"), std::string::npos);
  WorldConfig unnamed;
  unnamed.boxes.emplace_back();
  EXPECT_NE(message(unnamed).find("no name"), std::string::npos);
  WorldConfig flat;
  flat.planes.emplace_back().name = "p";
  flat.planes.back().normal = {0, 0, 0};
  EXPECT_NE(message(flat).find("'p'"), std::string::npos);
}

// Colour does not flicker along a face: moving the hit point through the face by rounding-size
// amounts does not change its cell, for any face and cell size.
TEST(World, PaintIsStableOnFlatFaces) {
  rt::Random rng(11);
  for (int i = 0; i < 200; ++i) {
    WorldConfig c;
    auto& b = c.boxes.emplace_back();
    b.name = std::to_string(i);
    b.paint.cell_m = 0.05 * static_cast<double>(rng.integer(1, 4));
    b.paint.contrast = 1;
    b.paint.texture = i % 2 == 0 ? "checker" : "noise";
    for (auto& e : b.size_m) e = 0.05 * static_cast<double>(rng.integer(1, 20));
    const World w = make(c);
    const Shape& s = w.shapes()[0];
    for (int a = 0; a < 3; ++a) {
      Vec3 p{rng.uniform(-1, 1) * s.half.x(), rng.uniform(-1, 1) * s.half.y(),
             rng.uniform(-1, 1) * s.half.z()};
      p[a] = s.half[a];
      Vec3 q = p;
      q[a] += 1e-9, p[a] -= 1e-9;
      ASSERT_EQ(drivers::surface_colour(s, p), drivers::surface_colour(s, q));
    }
  }
}

}  // namespace
}  // namespace tests
