// The analytic world against slow references: sphere tracing of its own distance field, dense
// sampling of the robot's body, and closed forms.
#include "drivers/world/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numbers>

#include "config/schema.hpp"
#include "rt/random.hpp"
#include "tests/support/world_scene.hpp"
#include "tests/unit/drivers_world/nearest_shape.hpp"

namespace {

using drivers::BodyBox;
using drivers::Shape;
using drivers::World;
using drivers::WorldConfig;
using perception::Vec3;

rt::Startup startup;

World make(const WorldConfig& c) { return World(startup.token(), c); }

// A room with `n` solids of every kind, turned at random, some of them overlapping.
WorldConfig random_world(rt::Random& rng, int n) {
  WorldConfig c;
  c.room.x_m = {-2, 3};
  c.room.y_m = {-2.5, 2};
  c.room.height_m = 2.2;
  const auto place = [&rng](std::array<double, 3>& p) {
    p = {rng.uniform(-1.8, 2.8), rng.uniform(-2.3, 1.8), rng.uniform(0.0, 1.5)};
  };
  for (int i = 0; i < n; ++i) {
    auto& b = c.boxes.emplace_back();
    b.name = "box" + std::to_string(i);
    place(b.position_m);
    b.size_m = {rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.8)};
    b.yaw_deg = rng.uniform(-180, 180);
    if (i % 2 == 0) b.pitch_deg = rng.uniform(-90, 90), b.roll_deg = rng.uniform(-90, 90);
    auto& y = c.cylinders.emplace_back();
    y.name = "cyl" + std::to_string(i);
    place(y.position_m);
    y.radius_m = rng.uniform(0.03, 0.4);
    y.height_m = rng.uniform(0.05, 1.0);
    auto& s = c.spheres.emplace_back();
    s.name = "sph" + std::to_string(i);
    place(s.position_m);
    s.radius_m = rng.uniform(0.03, 0.4);
    auto& r = c.capsules.emplace_back();
    r.name = "rod" + std::to_string(i);
    place(r.from_m);
    for (std::size_t a = 0; a < 3; ++a) r.to_m[a] = r.from_m[a] + rng.uniform(-0.6, 0.6);
    if (i % 4 == 3) r.to_m = r.from_m;  // a ball
    r.radius_m = rng.uniform(0.02, 0.2);
  }
  return c;
}

Vec3 random_direction(rt::Random& rng) {
  Vec3 d;
  do {
    d = {rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)};
  } while (d.norm() > 1 || d.norm() < 1e-3);
  return d.normalized();
}

Vec3 free_point(const World& w, rt::Random& rng, double clearance = 0.02) {
  for (;;) {
    const Vec3 p{rng.uniform(-2, 3), rng.uniform(-2.5, 2), rng.uniform(0, 2.2)};
    if (w.signed_distance(p) > clearance) return p;
  }
}

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

// ---- collision -------------------------------------------------------------------------------

// Slow reference: the smallest distance over a dense grid of points of the body's surface and
// inside. Returns {some sample is inside a solid, smallest distance of a sample to a solid}.
struct Sampled {
  bool inside = false;
  double distance = 1e9;
};
Sampled sample_body(const World& w, int shape, double x, double y, double yaw,
                    std::span<const BodyBox> body, int n) {
  Sampled r;
  const Eigen::AngleAxisd R(yaw, Vec3::UnitZ());
  for (const auto& part : body) {
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; j <= n; ++j) {
        for (int k = 0; k <= n; ++k) {
          const Vec3 u{2.0 * i / n - 1, 2.0 * j / n - 1, 2.0 * k / n - 1};
          const Vec3 p = Vec3(x, y, 0) + R * (part.centre_B + u.cwiseProduct(part.half));
          r.distance = std::min(r.distance, w.signed_distance(p, shape));
        }
      }
    }
  }
  r.inside = r.distance <= 0;
  return r;
}

TEST(Collision, AgreesWithDenseSampling) {
  const std::array<BodyBox, 2> body{
      {{{0.0, 0.0, 0.07}, {0.29, 0.188, 0.07}}, {{0.1, 0.0, 0.4}, {0.1, 0.1, 0.26}}}};
  constexpr int kN = 24;
  // A solid can slip between samples: with the largest cell's half diagonal as the tolerance the
  // two must agree.
  const double spacing = 2 * 0.29 / kN;
  int hits = 0, misses = 0, undecided = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    rt::Random rng(seed, 99);
    WorldConfig config = random_world(rng, 1);
    for (auto& b : config.boxes) b.position_m[2] = rng.uniform(0, 0.5);
    for (auto& b : config.cylinders) b.position_m[2] = rng.uniform(0, 0.5);
    for (auto& b : config.spheres) b.position_m[2] = rng.uniform(0, 0.5);
    const World w = make(config);
    for (int i = 0; i < 40; ++i) {
      const auto& target = w.shapes()[static_cast<std::size_t>(
          rng.integer(0, static_cast<int>(w.shapes().size()) - 1))];
      Vec3 at = target.X_WS.translation();
      const double x = at.x() + rng.uniform(-0.9, 0.9), y = at.y() + rng.uniform(-0.9, 0.9);
      const double yaw = rng.uniform(-3.2, 3.2);
      const int found = w.robot_collision(x, y, yaw, body);
      for (int s = 0; s < static_cast<int>(w.shapes().size()); ++s) {
        if (w.shapes()[static_cast<std::size_t>(s)].ground) continue;
        const Sampled ref = sample_body(w, s, x, y, yaw, body, kN);
        if (ref.inside) {
          ++hits;
          ASSERT_GE(found, 0) << "missed " << w.shapes()[static_cast<std::size_t>(s)].name;
        } else if (ref.distance > spacing) {
          ++misses;
          ASSERT_NE(found, s) << "invented " << w.shapes()[static_cast<std::size_t>(s)].name;
        } else {
          ++undecided;
        }
      }
    }
  }
  EXPECT_GT(hits, 60);
  EXPECT_GT(misses, 400);
  RecordProperty("undecided", undecided);
}

// Nearest point of a solid, in closed form.
Vec3 nearest_point(const Shape& s, const Vec3& p_W) {
  Vec3 p = s.X_WS.inverse() * p_W;
  switch (s.kind) {
    case Shape::Kind::kPlane:
      p.z() = std::min(p.z(), 0.0);
      break;
    case Shape::Kind::kBox:
      p = p.cwiseMin(s.half).cwiseMax(-s.half);
      break;
    case Shape::Kind::kCylinder: {
      const double r = std::hypot(p.x(), p.y());
      if (r > s.half.x()) p.head<2>() *= s.half.x() / r;
      p.z() = std::clamp(p.z(), -s.half.z(), s.half.z());
      break;
    }
    case Shape::Kind::kSphere:
      if (p.norm() > s.half.x()) p *= s.half.x() / p.norm();
      break;
    case Shape::Kind::kCapsule: {
      const Vec3 axis(0, 0, std::clamp(p.z(), -s.half.z(), s.half.z()));
      const double off = (p - axis).norm();
      if (off > s.half.x()) p = axis + (p - axis) * (s.half.x() / off);
      break;
    }
  }
  return s.X_WS * p;
}

// Distance of two convex bodies by projecting to and fro (von Neumann, Cheney-Goldstein 1959): from
// above, and 0 in the limit if they meet.
double alternating_distance(const Shape& solid, const Shape& body, int steps) {
  Vec3 b = body.X_WS.translation(), a = b;
  for (int i = 0; i < steps; ++i) {
    a = nearest_point(solid, b);
    const Vec3 next = nearest_point(body, a);
    const bool still = (next - b).norm() < 1e-13;
    b = next;
    if (still) break;
  }
  return (a - b).norm();
}

// Close encounters of every kind of solid with one body box. Boxes are turned any way, so contacts
// of two edges, which only the nine cross-product axes tell from a collision, are among them.
TEST(Collision, AgreesWithAlternatingProjections) {
  const std::array<BodyBox, 1> body{{{{0.05, -0.02, 0.3}, {0.2, 0.1, 0.15}}}};
  int hits = 0, misses = 0, close_misses = 0, undecided = 0;
  for (std::uint64_t seed = 1; seed <= 3600; ++seed) {
    rt::Random rng(seed, 7);
    WorldConfig c;
    const Vec3 from = random_direction(rng);
    const double away = rng.uniform(0.1, 0.5);
    const Vec3 at = Vec3(0, 0, 0.3) + away * from;
    switch (seed % 6) {
      case 0: {
        auto& y = c.cylinders.emplace_back();
        y.name = "s", y.radius_m = rng.uniform(0.02, 0.3), y.height_m = rng.uniform(0.02, 0.5);
        y.position_m = {at.x(), at.y(), at.z() - y.height_m / 2};
        break;
      }
      case 1: {
        auto& b = c.spheres.emplace_back();
        b.name = "s", b.radius_m = rng.uniform(0.02, 0.3), b.position_m = {at.x(), at.y(), at.z()};
        break;
      }
      case 2: {
        auto& p = c.planes.emplace_back();
        p.name = "s", p.point_m = {at.x(), at.y(), at.z()};
        p.normal = {-from.x(), -from.y(), -from.z()};
        break;
      }
      case 3: {
        auto& r = c.capsules.emplace_back();
        const Vec3 half = rng.uniform(0, 0.3) * random_direction(rng);
        r.name = "s", r.radius_m = rng.uniform(0.02, 0.2);
        r.from_m = {at.x() - half.x(), at.y() - half.y(), at.z() - half.z()};
        r.to_m = {at.x() + half.x(), at.y() + half.y(), at.z() + half.z()};
        break;
      }
      default: {
        auto& b = c.boxes.emplace_back();
        b.name = "s", b.position_m = {at.x(), at.y(), at.z()};
        b.size_m = {rng.uniform(0.02, 0.5), rng.uniform(0.02, 0.5), rng.uniform(0.02, 0.5)};
        b.yaw_deg = rng.uniform(-180, 180), b.pitch_deg = rng.uniform(-180, 180);
        b.roll_deg = rng.uniform(-180, 180);
      }
    }
    const World w = make(c);
    const double yaw = rng.uniform(-3.2, 3.2);
    Shape hull;
    hull.X_WS.linear() = Eigen::AngleAxisd(yaw, Vec3::UnitZ()).toRotationMatrix();
    hull.X_WS.translation() = hull.X_WS.linear() * body[0].centre_B;
    hull.half = body[0].half;
    const double d = alternating_distance(w.shapes()[0], hull, 20000);
    const bool found = w.robot_collision(0, 0, yaw, body) >= 0;
    if (d > 1e-5) {
      ++misses;
      close_misses += d < 0.02;
      ASSERT_FALSE(found) << "seed " << seed << " distance " << d;
    } else if (d < 1e-9) {
      ++hits;
      ASSERT_TRUE(found) << "seed " << seed;
    } else {
      ++undecided;  // touching, or not yet converged
    }
  }
  EXPECT_GT(hits, 800);
  EXPECT_GT(misses, 800);
  EXPECT_GT(close_misses, 60);
  EXPECT_LT(undecided, 15);
}

// The borders exactly: one nanometre off is free, one nanometre in is a collision.
TEST(Collision, ExactAtTheBorder) {
  constexpr double e = 1e-9;
  const std::array<BodyBox, 1> base{{{{0, 0, 0.07}, {0.29, 0.188, 0.07}}}};
  WorldConfig c;
  c.room.x_m = {-2, 5}, c.room.y_m = {-3, 3};
  const auto with = [&c](auto fill) {
    WorldConfig k = c;
    fill(k);
    return make(k);
  };
  const World walls = make(c);
  EXPECT_EQ(walls.robot_collision(5 - 0.29 - e, 0, 0, base), -1);
  EXPECT_EQ(walls.robot_collision(5 - 0.29 + e, 0, 0, base), walls.find("wall_x_max"));
  EXPECT_EQ(walls.robot_collision(0, -3 + 0.29 + e, std::numbers::pi / 2, base), -1);
  EXPECT_EQ(walls.robot_collision(0, -3 + 0.29 - e, std::numbers::pi / 2, base),
            walls.find("wall_y_min"));
  const double diagonal = (0.29 + 0.188) * std::numbers::sqrt2 / 2;
  EXPECT_EQ(walls.robot_collision(5 - diagonal - e, 0, std::numbers::pi / 4, base), -1);
  EXPECT_NE(walls.robot_collision(5 - diagonal + e, 0, std::numbers::pi / 4, base), -1);

  const World box = with([](WorldConfig& k) {
    auto& b = k.boxes.emplace_back();
    b.name = "b", b.size_m = {0.2, 0.2, 0.2}, b.position_m = {1, 0, 0.1}, b.yaw_deg = 45;
  });
  const double corner = 1 - 0.1 * std::numbers::sqrt2 - 0.29;
  EXPECT_EQ(box.robot_collision(corner - e, 0, 0, base), -1);
  EXPECT_EQ(box.robot_collision(corner + e, 0, 0, base), box.find("b"));

  const World cylinder = with([](WorldConfig& k) {
    auto& y = k.cylinders.emplace_back();
    y.name = "y", y.position_m = {1, 1, 0.13}, y.radius_m = 0.2, y.height_m = 1;
  });
  // Corner of the base against the round side.
  const double d = 0.2 * std::numbers::sqrt2 / 2;
  EXPECT_EQ(cylinder.robot_collision(1 - 0.29 - d - e, 1 - 0.188 - d - e, 0, base), -1);
  EXPECT_EQ(cylinder.robot_collision(1 - 0.29 - d + e, 1 - 0.188 - d + e, 0, base),
            cylinder.find("y"));

  const World above = with([](WorldConfig& k) {
    auto& b = k.boxes.emplace_back();
    b.name = "shelf", b.size_m = {1, 1, 0.1}, b.position_m = {0, 0, 0.14 + 0.05 + e};
    auto& s = k.spheres.emplace_back();
    s.name = "ball", s.radius_m = 0.1, s.position_m = {3, 0, 0.24 - e};
  });
  EXPECT_EQ(above.robot_collision(0, 0, 0.3, base), -1);             // passes under the shelf ...
  EXPECT_EQ(above.robot_collision(0, 0, 0.3), above.find("shelf"));  // ... but not with its mast
  EXPECT_EQ(above.robot_collision(3, 0, 0, base), above.find("ball"));
}

TEST(Collision, ThinAndParallelBoxes) {
  const std::array<BodyBox, 1> base{{{{0, 0, 0.07}, {0.29, 0.188, 0.07}}}};
  WorldConfig c;
  auto& b = c.boxes.emplace_back();
  b.name = "rod", b.size_m = {0.001, 3, 0.001}, b.position_m = {0.5, 0, 0.05}, b.yaw_deg = 0;
  const World w = make(c);
  EXPECT_EQ(w.robot_collision(0.2, 0, 0, base), -1);
  EXPECT_EQ(w.robot_collision(0.22, 0, 0, base), 0);
  EXPECT_EQ(w.robot_collision(0.5, 0, 1.0, base), 0);  // the rod passes through the middle
}

// ---- scene files -----------------------------------------------------------------------------

World load(const std::string& scene) { return test_support::load_world(startup.token(), scene); }

// Point of the first press of the scene's hand: where the mark on the floor will be.
Vec3 first_press(const std::string& scene) {
  std::ifstream file(test_support::scene_path(scene));
  Vec3 p = Vec3::Constant(std::nan(""));
  for (std::string line; std::getline(file, line);) {
    if (line != "kind = \"press\"") continue;
    std::getline(file, line);
    EXPECT_EQ(std::sscanf(line.c_str(), "point_m = [%lf, %lf, %lf]", &p[0], &p[1], &p[2]), 3);
    break;
  }
  return p;
}

bool free_any_heading(const World& w, double x, double y) {
  for (double yaw = -3.2; yaw < 3.2; yaw += 0.1) {
    if (w.robot_collision(x, y, yaw) >= 0) return false;
  }
  return true;
}

// Flood fill on a 5 cm grid of places that are free at any heading.
bool way_exists(const World& w, double x1, double y1) {
  constexpr int kN = 61;  // -1 ... 2 m in x and y
  const auto cell = [](double v) { return static_cast<int>(std::lround((v + 1) / 0.05)); };
  std::vector<char> seen(kN * kN, 0);
  std::vector<std::pair<int, int>> open{{cell(0), cell(0)}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (i < 0 || j < 0 || i >= kN || j >= kN || seen[static_cast<std::size_t>(i * kN + j)])
      continue;
    seen[static_cast<std::size_t>(i * kN + j)] = 1;
    if (!free_any_heading(w, i * 0.05 - 1, j * 0.05 - 1)) continue;
    if (i == cell(x1) && j == cell(y1)) return true;
    for (const auto& [di, dj] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      open.emplace_back(i + di, j + dj);
    }
  }
  return false;
}

TEST(Scenes, DefaultRoomIsWhatItsHeadSays) {
  const World w = load("default_room.toml");
  const Vec3 goal = first_press("default_room.toml");
  ASSERT_TRUE(goal.allFinite());
  EXPECT_EQ(goal.z(), 0);
  EXPECT_GT(goal.norm(), 1.5);
  EXPECT_TRUE(free_any_heading(w, 0, 0));
  EXPECT_TRUE(free_any_heading(w, goal.x(), goal.y()));
  // The straight way to it is not free, a way round is.
  bool blocked = false;
  for (double a = 0; a <= 1; a += 0.01) {
    blocked = blocked || w.robot_collision(a * goal.x(), a * goal.y(), 0) >= 0;
  }
  EXPECT_TRUE(blocked);
  EXPECT_TRUE(way_exists(w, goal.x(), goal.y()));
  // From the start the camera sees the floor of the goal, and the pedestal's top and one side.
  const Vec3 lens{-0.2, 0, 0.95};
  for (const double dx : {-0.05, 0.0, 0.05}) {
    for (const double dy : {-0.05, 0.0, 0.05}) {
      EXPECT_EQ(w.ray_cast(lens, goal + Vec3(dx, dy, 0) - lens).shape, w.find("floor"));
    }
  }
  const int pedestal = w.find("pedestal");
  ASSERT_GE(pedestal, 0);
  const Shape& shape = w.shapes()[static_cast<std::size_t>(pedestal)];
  const Vec3 top = shape.X_WS * Vec3(0, 0, shape.half.z());
  const Vec3 front = shape.X_WS * Vec3(-shape.half.x(), 0, 0.05);
  const auto on_top = w.ray_cast(lens, (top - lens).normalized());
  const auto on_front = w.ray_cast(lens, (front - lens).normalized());
  EXPECT_EQ(on_top.shape, pedestal);
  EXPECT_GT(on_top.normal_W.z(), 0.99);
  EXPECT_EQ(on_front.shape, pedestal);
  EXPECT_LT(std::abs(on_front.normal_W.z()), 1e-9);
  EXPECT_GT(on_front.t, 1.2);
  EXPECT_LT(on_front.t, 2.0);
}

TEST(Scenes, OtherScenesLoadAndStartFree) {
  for (const char* scene : {"corridor.toml", "empty_room.toml"}) {
    const World w = load(scene);
    EXPECT_EQ(w.robot_collision(0, 0, 0), -1);
    EXPECT_GE(w.find("floor"), 0);
  }
  EXPECT_EQ(load("empty_room.toml").shapes().size(), 6u);
}

TEST(Scenes, WrongKeysAreNamed) {
  WorldConfig c;
  config::Section root;
  c.describe(root.section("world"));
  const auto bad =
      config::load_text("[[world.box]]\nname = \"a\"\nsize_m = [0, 1, 1]\n", "s.toml", root);
  ASSERT_FALSE(bad.has_value());
  EXPECT_NE(bad.error().find("size_m"), std::string::npos);
  EXPECT_NE(bad.error().find("s.toml"), std::string::npos);
}

}  // namespace
