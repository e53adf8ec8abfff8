// The robot's body against the solids of a world: dense sampling of the body, alternating
// projections, and the borders in closed form.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "drivers/world/world.hpp"
#include "tests/unit/drivers_world/random_world.hpp"

namespace tests {
namespace {

using drivers::BodyBox;
using drivers::Shape;

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

}  // namespace
}  // namespace tests
