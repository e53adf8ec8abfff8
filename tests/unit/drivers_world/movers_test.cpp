// Shapes that move: closed forms of the motions, and a world at an instant against one built with
// everything standing where it is then.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "config/schema.hpp"
#include "drivers/world/world.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_world/nearest_shape.hpp"

namespace {

using drivers::MoverConfig;
using drivers::World;
using drivers::WorldConfig;
using perception::Pose;
using perception::Vec3;

rt::Startup startup;
constexpr double kDegree = std::numbers::pi / 180;
constexpr rt::Time kBegin{rt::Nanos{5'000'000'000}};

rt::Time at(double t_s) { return kBegin + rt::nanos_from_seconds(t_s); }

WorldConfig things() {
  WorldConfig c;
  c.room.x_m = {-3, 3}, c.room.y_m = {-3, 3}, c.room.height_m = 2.5;
  auto& b = c.boxes.emplace_back();
  b.name = "box", b.size_m = {0.4, 0.3, 0.5}, b.position_m = {0.5, 0.2, 0.25}, b.yaw_deg = 25;
  auto& body = c.cylinders.emplace_back();
  body.name = "body", body.position_m = {-1, 0.5, 0}, body.radius_m = 0.2, body.height_m = 1.5;
  auto& head = c.spheres.emplace_back();
  head.name = "head", head.position_m = {-1, 0.5, 1.65}, head.radius_m = 0.12;
  return c;
}

MoverConfig& mover(WorldConfig& c, const char* name, const char* shapes, const char* kind) {
  auto& m = c.movers.emplace_back();
  m.name = name, m.shapes = shapes, m.kind = kind;
  return m;
}

Vec3 centre(const World& w, const char* shape, double t_s) {
  return w.X_WS_at(w.find(shape), at(t_s)).translation();
}

void expect_near(const Vec3& a, const Vec3& b) {
  EXPECT_LT((a - b).norm(), 1e-12) << a.transpose() << " | " << b.transpose();
}

TEST(Movers, LineStartsLastsAndStops) {
  WorldConfig c = things();
  auto& m = mover(c, "slides", "box", "line");
  m.start_s = 2, m.duration_s = 3, m.velocity_m_per_s = {0.1, -0.2, 0};
  const World w(startup.token(), c, kBegin);
  const Vec3 from(0.5, 0.2, 0.25), v(0.1, -0.2, 0);
  expect_near(centre(w, "box", -1), from);  // before there is a world
  expect_near(centre(w, "box", 2), from);
  expect_near(centre(w, "box", 3.5), from + 1.5 * v);
  expect_near(centre(w, "box", 5), from + 3 * v);
  expect_near(centre(w, "box", 60), from + 3 * v);
  expect_near(centre(w, "head", 60), Vec3(-1, 0.5, 1.65));  // nobody moves it
}

TEST(Movers, ShuttleGoesThereAndBack) {
  WorldConfig c = things();
  auto& m = mover(c, "walks", "body, head", "shuttle");
  m.way_m = {0.6, 0.8, 0}, m.speed_m_per_s = 0.5;  // 2 s there, 2 s back
  const World w(startup.token(), c, kBegin);
  const Vec3 from(-1, 0.5, 0.75), way(0.6, 0.8, 0);
  for (const auto& [t, f] : {std::pair{0.0, 0.0},
                             {1.0, 0.5},
                             {2.0, 1.0},
                             {3.0, 0.5},
                             {4.0, 0.0},
                             {4.5, 0.25},
                             {10.0, 1.0}}) {
    expect_near(centre(w, "body", t), from + f * way);
    expect_near(centre(w, "head", t) - centre(w, "body", t), Vec3(0, 0, 0.9));  // rigid
  }
}

TEST(Movers, SwingIsASine) {
  WorldConfig c = things();
  auto& m = mover(c, "sways", "box", "swing");
  m.amplitude_m = {0, 0.3, 0}, m.period_s = 4;
  const World w(startup.token(), c, kBegin);
  for (const double t : {0.0, 0.5, 1.0, 1.7, 3.0, 5.0}) {
    const double s = std::sin(2 * std::numbers::pi * t / 4);
    expect_near(centre(w, "box", t), Vec3(0.5, 0.2 + 0.3 * s, 0.25));
  }
}

TEST(Movers, HingeTurnsAboutItsAxisToItsAngle) {
  WorldConfig c = things();
  auto& m = mover(c, "door", "box", "hinge");
  m.point_m = {0.1, 0.2, 0}, m.rate_deg_per_s = 30, m.angle_deg = -90, m.start_s = 1;
  auto& n = mover(c, "to and fro", "head", "hinge");
  n.point_m = {-1, 0, 0}, n.rate_deg_per_s = 45, n.angle_deg = 90, n.back = true;
  const World w(startup.token(), c, kBegin);
  for (const auto& [t, deg] :
       {std::pair{0.5, 0.0}, {2.0, -30.0}, {3.5, -75.0}, {4.0, -90.0}, {9.0, -90.0}}) {
    const double a = deg * kDegree;
    expect_near(centre(w, "box", t), Vec3(0.1 + 0.4 * std::cos(a), 0.2 + 0.4 * std::sin(a), 0.25));
    const Pose X = w.X_WS_at(w.find("box"), at(t));
    EXPECT_NEAR(std::atan2(X.linear()(1, 0), X.linear()(0, 0)), (25 + deg) * kDegree, 1e-12);
  }
  expect_near(centre(w, "head", 1), Vec3(-1 - 0.5 * std::sqrt(0.5), 0.5 * std::sqrt(0.5), 1.65));
  expect_near(centre(w, "head", 2), Vec3(-1.5, 0, 1.65));
  expect_near(centre(w, "head", 4), Vec3(-1, 0.5, 1.65));
}

TEST(Movers, WaypointsAreJoinedByStraightWays) {
  WorldConfig c = things();
  auto& m = mover(c, "goes", "box", "waypoints");
  m.waypoints.push_back({1, {0, 0, 0}, 0});
  m.waypoints.push_back({2, {1, 0, 0.5}, 0});
  m.waypoints.push_back({4, {1, -1, 0.5}, 0});
  const World w(startup.token(), c, kBegin);
  const Vec3 from(0.5, 0.2, 0.25);
  expect_near(centre(w, "box", 0), from);
  expect_near(centre(w, "box", 1.25), from + Vec3(0.25, 0, 0.125));
  expect_near(centre(w, "box", 3), from + Vec3(1, -0.5, 0.5));
  expect_near(centre(w, "box", 40), from + Vec3(1, -1, 0.5));
}

// An arm of two links: the second turns about an elbow that the first carries.
TEST(Movers, ALinkIsCarriedByTheOneBefore) {
  WorldConfig c = things();
  auto& upper = mover(c, "shoulder", "box", "hinge");
  upper.rate_deg_per_s = 10, upper.angle_deg = 90;
  auto& fore = mover(c, "elbow", "head", "hinge");
  fore.on = "shoulder", fore.point_m = {1, 0, 0}, fore.rate_deg_per_s = 20, fore.angle_deg = 180;
  c.spheres[0].position_m = {1.5, 0, 0.3};
  const World w(startup.token(), c, kBegin);
  for (const double t : {0.0, 1.0, 3.0, 6.5}) {
    const double a = 10 * t * kDegree, b = 30 * t * kDegree;  // of the links, against the world
    expect_near(centre(w, "head", t),
                Vec3(std::cos(a) + 0.5 * std::cos(b), std::sin(a) + 0.5 * std::sin(b), 0.3));
  }
}

TEST(Movers, AWalkGoesThroughItsWaypointsAtItsSpeed) {
  WorldConfig c = things();
  auto& m = mover(c, "walks", "body, head", "walk");
  m.start_s = 2, m.speed_m_per_s = 0.5;
  m.waypoints.push_back({0, {1, 0, 0}, 0, 1.5});
  m.waypoints.push_back({0, {1, -2, 0}, 0});
  const World w(startup.token(), c, kBegin);
  const Vec3 from(-1, 0.5, 0.75);
  for (const auto& [t, way] : {std::pair{0.0, Vec3(0, 0, 0)},
                               {2.0, Vec3(0, 0, 0)},
                               {3.0, Vec3(0.5, 0, 0)},
                               {4.0, Vec3(1, 0, 0)},
                               {5.4, Vec3(1, 0, 0)},  // it stands until 5.5
                               {6.5, Vec3(1, -0.5, 0)},
                               {9.5, Vec3(1, -2, 0)},
                               {60.0, Vec3(1, -2, 0)}}) {
    expect_near(centre(w, "body", t), from + way);
    expect_near(centre(w, "head", t), from + way + Vec3(0, 0, 0.9));
  }
}

// The oracle: a world without movers, everything where it is at that instant.
TEST(Movers, EveryQuestionIsAboutItsInstant) {
  WorldConfig c = things();
  auto& m = mover(c, "slides", "box", "line");
  m.velocity_m_per_s = {-0.25, 0.125, 0};
  auto& n = mover(c, "walks", "body, head", "shuttle");
  n.way_m = {1, 0, 0}, n.speed_m_per_s = 0.5;
  const World w(startup.token(), c, kBegin);
  EXPECT_TRUE(w.moves());
  const std::uint64_t seed = 12;
  rt::Random rng(seed);
  int hits = 0, bumps = 0;
  for (const double t : {0.0, 0.7, 2.9}) {
    WorldConfig then = things();
    const auto put = [&](std::array<double, 3>& p, const char* shape, double down) {
      const Vec3 q = centre(w, shape, t);
      p = {q.x(), q.y(), q.z() - down};
    };
    put(then.boxes[0].position_m, "box", 0);
    put(then.cylinders[0].position_m, "body", 0.75);
    put(then.spheres[0].position_m, "head", 0);
    const World still(startup.token(), then);
    EXPECT_FALSE(still.moves());
    for (int i = 0; i < 400; ++i) {
      const Vec3 p(rng.uniform(-2.9, 2.9), rng.uniform(-2.9, 2.9), rng.uniform(0, 2.4));
      // Towards one of them, roughly.
      const Vec3 to = centre(w, i % 3 == 0 ? "box" : i % 3 == 1 ? "body" : "head", t);
      const Vec3 d = to - p + 0.2 * Vec3(rng.normal(), rng.normal(), rng.normal());
      EXPECT_NEAR(w.signed_distance(p, at(t)), still.signed_distance(p), 1e-12) << "seed " << seed;
      EXPECT_EQ(nearest_shape(w, p, at(t)), nearest_shape(still, p));
      const auto a = w.ray_cast(p, d, at(t)), b = still.ray_cast(p, d);
      ASSERT_EQ(a.shape, b.shape) << "seed " << seed;
      EXPECT_NEAR(a.t, b.t, 1e-9);
      hits += a.shape >= 6 ? 1 : 0;
      const double x = rng.uniform(-2, 2), y = rng.uniform(-2, 2), yaw = rng.uniform(-3, 3);
      const int bump = w.robot_collision(x, y, yaw, at(t));
      EXPECT_EQ(bump, still.robot_collision(x, y, yaw)) << "seed " << seed;
      bumps += bump >= 6 ? 1 : 0;
    }
  }
  EXPECT_GT(hits, 100);
  EXPECT_GT(bumps, 40);
}

TEST(Movers, AWorldWithoutThemIsTheSameAtAnyInstant) {
  const World w(startup.token(), things(), kBegin);
  EXPECT_FALSE(w.moves());
  const Vec3 p(0.3, -0.4, 0.9), d(0.2, 0.9, -0.3);
  EXPECT_EQ(w.signed_distance(p), w.signed_distance(p, at(17)));
  EXPECT_EQ(w.ray_cast(p, d).t, w.ray_cast(p, d, at(17)).t);
  EXPECT_EQ(w.X_WS_at(7, at(17)).matrix(), w.shapes()[7].X_WS.matrix());
}

void expect_refused(const std::function<void(WorldConfig&)>& change, const char* what) {
  WorldConfig c = things();
  change(c);
  try {
    const World w(startup.token(), c);
    ADD_FAILURE() << "not refused: " << what;
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find(what), std::string::npos) << e.what();
  }
}

TEST(Movers, WhatCanNotMoveIsRefused) {
  expect_refused([](WorldConfig& c) { mover(c, "m", "bock", "line"); }, "no shape 'bock'");
  expect_refused([](WorldConfig& c) { mover(c, "m", "", "line"); }, "names none");
  expect_refused([](WorldConfig& c) { mover(c, "", "box", "line"); }, "no name");
  expect_refused([](WorldConfig& c) { mover(c, "m", "wall_x_max", "line"); }, "is a plane");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box, box", "line"); }, "has a mover");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box", "shuttle"); }, "way_m");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box", "waypoints"); }, "no waypoint");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box", "walk"); }, "no waypoint");
  expect_refused(
      [](WorldConfig& c) {
        mover(c, "m", "box", "walk").waypoints.push_back({1, {1, 0, 0}, 0});
      },
      "waypoint.at_s");
  expect_refused(
      [](WorldConfig& c) {
        mover(c, "m", "box", "walk").waypoints.push_back({0, {0, 0, 0}, 0});
      },
      "waypoint.offset_m");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box", "hinge").axis = {0, 0, 0}; }, "axis");
  expect_refused([](WorldConfig& c) { mover(c, "m", "box", "line").on = "k"; }, "no mover before");
  expect_refused([](WorldConfig& c) { mover(c, "m", "body", "hinge").axis = {1, 0, 0}; }, "tilt");
  expect_refused(
      [](WorldConfig& c) {
        mover(c, "a", "box", "hinge").axis = {0, 1, 0};
        mover(c, "b", "body", "line").on = "a";
      },
      "tilt");
  expect_refused(
      [](WorldConfig& c) {
        mover(c, "m", "box", "line");
        mover(c, "m", "body", "line");
      },
      "twice");
  expect_refused(
      [](WorldConfig& c) {
        auto& m = mover(c, "m", "box", "waypoints");
        m.waypoints.push_back({2, {0, 0, 0}, 0});
        m.waypoints.push_back({2, {1, 0, 0}, 0});
      },
      "not after");
}

TEST(Movers, ASceneFileNamesThem) {
  WorldConfig c;
  config::Section root;
  c.describe(root.section("world"));
  const auto ok = config::load_text(R"([[world.cylinder]]
name = "person"
position_m = [0, 0, 0]
radius_m = 0.25
height_m = 1.7
[[world.mover]]
name = "visitor"
shapes = "person"
kind = "waypoints"
[[world.mover.waypoint]]
at_s = 1
[[world.mover.waypoint]]
at_s = 3
offset_m = [2, 0, 0]
)",
                                    "visitor.toml", root);
  ASSERT_TRUE(ok) << ok.error();
  const World w(startup.token(), c);
  EXPECT_EQ(w.robot_collision(1, 0, 0, rt::Time{} + rt::Nanos{500'000'000}), -1);
  EXPECT_EQ(w.robot_collision(1, 0, 0, rt::Time{} + rt::Nanos{2'000'000'000}), 0);
  EXPECT_EQ(w.robot_collision(1, 0, 0, rt::Time{} + rt::Nanos{4'000'000'000}), -1);
  WorldConfig d;
  config::Section bad;
  d.describe(bad.section("world"));
  const auto refused = config::load_text("[[world.mover]]\nspeed_m_per_s = 50\n", "f.toml", bad);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("speed_m_per_s"), std::string::npos) << refused.error();
}

}  // namespace
