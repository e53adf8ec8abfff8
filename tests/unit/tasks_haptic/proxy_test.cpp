// Rules of the proxy beyond the hard cases (tests/stability).
#include <gtest/gtest.h>

#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using rig::Path;
using rig::Placement;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;

constexpr double kSpeed = 0.1;

Scene scene_of(const Placement& place, std::function<double(const Vec3&)> solid) {
  Scene s;
  s.solid = [solid = std::move(solid)](const Vec3& p, double) { return solid(p); };
  s.X_WS = place.X_WS;
  s.still = true;
  return s;
}

TEST(Proxy, ComingFromTheUnknownGivesNoForce) {
  // Seen only below z = -15 mm, as from behind: the hand rises through the solid and never meets
  // free.
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  s.seen = [](const Vec3& p) { return p.z() < 0.04 && p.z() > -0.03; };
  Rig r(s);
  const Path path({{0, 0, -0.08}, {0, 0, -0.005}}, 0.1);
  for (const Row& row : r.run(path, 0, path.duration())) EXPECT_EQ(row.f.norm(), 0) << row.t;
  // Out to seen-free space and back: now it is touched.
  const Path back({{0, 0, -0.005}, {0, 0, 0.015}, {0, 0, -0.005}}, 0.1);
  const auto rows = r.run(back, 0, back.duration());
  EXPECT_NEAR(rows.back().f.z(), 4.9, 0.1);
  EXPECT_EQ(rows[30].f.norm(), 0);
}

// A finite tip: the constraint is field >= radius, whatever the slope of the field.
TEST(Proxy, TipRadius) {
  for (const double slope : {1.0, 1.6}) {  // 1.6: a projective field seen at 51 degrees
    for (const Placement& place : rig::placements()) {
      Scene s = scene_of(place, [=](const Vec3& p) { return slope * p.z(); });
      s.config.tip_radius_m = 0.003;
      Rig r(s);
      const Path path({{-0.02, 0, 0.01}, {-0.02, 0, -0.005}, {0.02, 0, -0.005}}, kSpeed);
      const auto rows = r.run(path, 0, path.duration());
      for (const Row& row : rows) {
        if (row.h.z() < 0.0029) {
          EXPECT_NEAR(row.p.z(), 0.003, 0.02e-3) << slope << place.name;
        }
      }
      EXPECT_NEAR(rows.back().f.z(), 8, 0.05);
    }
  }
}

// The baselines work, and are what the table says: no memory.
TEST(Proxy, BaselinesLoseThePlateThatTheProxyHolds) {
  for (const char* method : {"nearest", "nearest10"}) {
    Scene s = scene_of(rig::placements()[0], [](const Vec3& p) { return solids::plate(p, 0.02); });
    s.config.method = method;
    Rig r(s);
    const Path press({{0, 0, 0.015}, {0, 0, 0.006}}, kSpeed);
    EXPECT_NEAR(r.run(press, 0, press.duration()).back().f.z(), 3.9, 0.2) << method;
    const Path on({{0, 0, 0.006}, {0, 0, -0.006}}, kSpeed);
    EXPECT_LT(r.run(on, 0, on.duration()).back().f.z(), -1.0) << method;
  }
}

TEST(Proxy, SaysWhereAWallIsThinnerThanAVoxel) {
  for (const auto& [thickness, flagged] : {std::pair{0.006, true}, std::pair{0.03, false}}) {
    Rig r(scene_of(rig::placements()[1],
                   [d = thickness](const Vec3& p) { return solids::plate(p, d); }));
    const Path press({{0, 0, 0.025}, {0, 0, 0.0}}, kSpeed);
    int n = 0;
    for (const Row& row : r.run(press, 0, press.duration())) n += row.telemetry.unresolved ? 1 : 0;
    EXPECT_EQ(n > 0, flagged) << thickness;
  }
}

// A hand slides off an edge while windows come that change nothing: what its spring held is lost,
// and no surface took it. One that sinks takes its part.
TEST(Booking, WhatASlipLosesIsNotTheSurfaces) {
  Scene scene;
  scene.solid = [](const Vec3& p, double) { return solids::convex_edge(p); };
  scene.still = true;
  Rig r(std::move(scene));
  const rig::Path path({{-0.03, 0, 0.004}, {-0.03, 0, -0.006}, {0.02, 0, -0.006}}, 0.1);
  double most = 0;
  for (const rig::Row& row : r.run(path, 0, path.duration())) {
    most = std::max(most, std::abs(row.telemetry.booked_J));
  }
  EXPECT_LT(most, 0.1e-3);
  EXPECT_GT(r.out().telemetry.energy_J, 0.015);
  EXPECT_FALSE(r.out().telemetry.in_contact);

  Scene sinking;
  sinking.solid = [](const Vec3& p, double t) { return p.z() + (t > 0.5 ? 0.003 : 0); };
  Rig below(std::move(sinking));
  const rig::Path down({{0, 0, 0.004}, {0, 0, -0.006}}, 0.1);
  below.run(down, 0, 0.3);
  below.run([](double) { return Vec3(0, 0, -0.006); }, 0, 0.5);
  EXPECT_NEAR(below.out().telemetry.booked_J, 0.5 * 1000 * (0.003 * 0.003 - 0.006 * 0.006), 0.2e-3);
}

}  // namespace
