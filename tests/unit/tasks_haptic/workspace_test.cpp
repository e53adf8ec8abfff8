// Scale, clutch, view and border: where the scene's hand is, and what the force does meanwhile.
#include "tasks/haptic/workspace.hpp"

#include <gtest/gtest.h>

#include "rt/random.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using rig::Path;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;
using tasks::Workspace;

rt::Random seeded(std::uint64_t seed) {
  std::printf("seed %llu\n", static_cast<unsigned long long>(seed));
  return rt::Random(seed);
}

Vec3 draw(rt::Random& random, double size) {
  return {random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size)};
}

TEST(Workspace, ToWorldAndBack) {
  rt::Random random = seeded(3);
  for (int i = 0; i < 200; ++i) {
    tasks::WorkspaceConfig c{random.uniform(0.1, 10), draw(random, 2), random.uniform(-7, 7)};
    const Workspace w(c);
    const Vec3 p = draw(random, 0.08), q = draw(random, 0.08);
    EXPECT_NEAR((w.to_device(w.to_world(p)) - p).norm(), 0, 1e-12);
    EXPECT_NEAR((w.to_world(p) - w.to_world(q)).norm(), c.scale * (p - q).norm(), 1e-12);
    EXPECT_NEAR((w.to_world(Vec3::Zero()) - c.p_WD).norm(), 0, 1e-12);
  }
}

// The scene's hand never leaps: whatever the clutch and the view do, it moves by scale times the
// device's motion, or not at all.
TEST(Workspace, ClutchNeverMakesTheHandLeap) {
  rt::Random random = seeded(5);
  for (int round = 0; round < 50; ++round) {
    tasks::WorkspaceConfig c{random.uniform(0.2, 6), draw(random, 1), random.uniform(-3, 3)};
    Workspace w(c);
    Vec3 p = draw(random, 0.05);
    Vec3 h = w.advance(p, false, {}, 1e-3);
    bool clutch = false;
    for (int k = 0; k < 400; ++k) {
      const Vec3 step = draw(random, 2e-4);
      p += step;
      if (random.uniform() < 0.05) clutch = !clutch;
      const std::optional<double> view =
          random.uniform() < 0.3 ? std::optional<double>(random.uniform(-3, 3)) : std::nullopt;
      const tasks::WorkspaceConfig& config = c;
      const Vec3 next = w.advance(p, clutch, view, 1e-3);
      EXPECT_NEAR((next - h).norm(), clutch ? 0 : config.scale * step.norm(), 1e-9);
      EXPECT_NEAR((w.to_world(p) - next).norm(), 0, 1e-12);
      h = next;
    }
  }
}

TEST(Workspace, ViewTurnsAwayFromTheOperatorToWhereItLooks) {
  perception::Mat3 R_WV;  // optical: looks along (0.6, 0.8, 0), upright
  const Vec3 ahead(0.6, 0.8, 0), down(0, 0, -1);
  R_WV.col(2) = ahead;
  R_WV.col(1) = down;
  R_WV.col(0) = down.cross(ahead);
  const auto yaw = tasks::yaw_of_view(R_WV);
  ASSERT_TRUE(yaw);
  Workspace w({1.0, Vec3::Zero(), 0.0});
  (void)w.advance(Vec3::Zero(), false, yaw, 1e-3);
  EXPECT_NEAR((w.R_WD() - perception::Mat3::Identity()).norm(), 0, 1e-12)
      << "not without the clutch";
  (void)w.advance(Vec3::Zero(), true, yaw, 1e-3);
  EXPECT_NEAR((w.R_WD() * Vec3::UnitX() - ahead).norm(), 0, 1e-12);
  R_WV.col(2) = Vec3(0, 0, -1);  // straight down: no way is "away"
  EXPECT_FALSE(tasks::yaw_of_view(R_WV));
}

TEST(Workspace, BorderMovesTheWorkspaceAtARate) {
  tasks::WorkspaceConfig c{2.0, Vec3::Zero(), 0.4, 0.05, 3.0};
  Workspace w(c);
  const Vec3 inside(0.04, 0, 0), outside(0.06, 0, 0);
  for (int k = 0; k < 100; ++k) (void)w.advance(inside, false, {}, 1e-3);
  EXPECT_NEAR(w.p_WD().norm(), 0, 1e-12);
  EXPECT_FALSE(w.beyond());
  for (int k = 0; k < 1000; ++k) (void)w.advance(outside, false, {}, 1e-3);
  EXPECT_TRUE(w.beyond());
  // 10 mm beyond, 3 /s, scale 2: 60 mm in a second, the way the hand points.
  EXPECT_NEAR((w.p_WD() - w.R_WD() * Vec3(0.06, 0, 0)).norm(), 0, 1e-9);
}

Scene floor_scene() {
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  return s;
}

// Clutched while pressed: the force goes to zero without a step, stays there while the device
// moves, and comes back as it was.
TEST(Workspace, ForceFadesWithTheClutchAndComesBack) {
  Rig r(floor_scene());
  r.run(Path({{0, 0, 0.01}, {0, 0, -0.008}}, 0.1), 0, 0.25);
  double before = r.out().force.f_H_D.norm();
  EXPECT_NEAR(before, 8, 0.05);
  const auto hand = [](double t) { return Vec3(0.1 * t, 0, -0.008 + 0.05 * t); };
  r.in().clutch = true;
  double largest = 0;
  Row row{};
  for (int k = 0; k < 200; ++k) {
    row = r.tick(hand(1e-3 * k));
    largest = std::max(largest, std::abs(row.f.norm() - before));
    before = row.f.norm();
    if (k > 120) {
      EXPECT_EQ(row.f.norm(), 0);
    }
    EXPECT_TRUE(row.telemetry.clutched);
    EXPECT_NEAR((r.out().state.p_WH - Vec3(0, 0, -0.008)).norm(), 0, 1e-12);
  }
  r.in().clutch = false;
  for (int k = 0; k < 100; ++k) {
    row = r.tick(hand(0.199));
    largest = std::max(largest, std::abs(row.f.norm() - before));
    before = row.f.norm();
  }
  EXPECT_NEAR(row.f.norm(), 8, 0.05) << "the scene's hand is where it was";
  EXPECT_LE(largest, 0.3);
  EXPECT_GE(row.telemetry.energy_J + row.telemetry.booked_J, -1e-3);
}

// Beyond the border the hand is driven into a wall: the force rises no faster than the guard
// allows, and what the workspace puts into the spring is booked.
TEST(Workspace, BorderPressesSoftlyAndIsBooked) {
  Scene s = floor_scene();
  s.config.border_m = 0.03;
  s.config.border_rate_per_s = 2;
  s.config.workspace_W_m = {0, 0, 0.035};
  Rig r(s);
  // Down to 10 mm beyond the border, 5 mm over the floor; then the workspace carries it on.
  const auto hand = [](double t) { return Vec3(0, 0, -std::min(0.04, 0.1 * t)); };
  double before = 0, largest = 0;
  for (int k = 0; k < 1500; ++k) {
    const Row row = r.tick(hand(1e-3 * k));
    largest = std::max(largest, std::abs(row.f.norm() - before));
    before = row.f.norm();
  }
  EXPECT_GT(before, 5);
  EXPECT_LE(largest, 0.3 + 1e-9);
  EXPECT_GT(r.out().telemetry.booked_J, 1e-3);
  EXPECT_GE(r.out().telemetry.energy_J + r.out().telemetry.booked_J, -1e-3);
  EXPECT_TRUE(r.out().telemetry.beyond);
}

}  // namespace
