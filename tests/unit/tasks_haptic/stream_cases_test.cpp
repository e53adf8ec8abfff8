// Hard cases where the surface, the observation or the hand's side changes: noise, steps, motion,
// carving, borders, starts.
#include <gtest/gtest.h>

#include <map>

#include "rt/random.hpp"
#include "tests/unit/tasks_haptic/rig.hpp"
#include "tests/unit/tasks_haptic/solids.hpp"

namespace {

using rig::Figures;
using rig::Path;
using rig::Placement;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;

double deviation(const std::vector<double>& v) {
  double mean = 0, sum = 0;
  for (const double x : v) mean += x / static_cast<double>(v.size());
  for (const double x : v) sum += (x - mean) * (x - mean);
  return std::sqrt(sum / static_cast<double>(v.size()));
}

// Height of the zero crossing of the noisy field over (0, 0), by interpolation along z of the
// trilinear values; frame by frame.
double surface_height(const Rig& r, int frame) {
  const Scene& s = r.setup();
  const auto value = [&](const Vec3& p) {
    const Vec3 q = p / s.voxel;
    const Eigen::Array3i i = q.array().floor().cast<int>();
    double sum = 0;
    for (int c = 0; c < 8; ++c) {
      const int a = c >> 2, b = (c >> 1) & 1, d = c & 1;
      const double w = (a ? q.x() - i.x() : 1 - q.x() + i.x()) *
                       (b ? q.y() - i.y() : 1 - q.y() + i.y()) *
                       (d ? q.z() - i.z() : 1 - q.z() + i.z());
      sum += w * (r.node(i.x() + a, i.y() + b, i.z() + d, 0) +
                  s.extra(i.x() + a, i.y() + b, i.z() + d, frame));
    }
    return sum;
  };
  double lo = -0.02, hi = 0.02;
  for (int k = 0; k < 40; ++k) {
    const double m = 0.5 * (lo + hi);
    (value(s.X_WS * Vec3(0, 0, m)) > 0 ? hi : lo) = m;
  }
  return 0.5 * (lo + hi);
}

Scene noisy_floor(const Placement& place, double sigma) {
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  s.X_WS = place.X_WS;
  s.moving = true;
  s.extra = [sigma](int x, int y, int z, int frame) {
    const auto key = (static_cast<std::uint64_t>(x + 4096) << 40U) |
                     (static_cast<std::uint64_t>(y + 4096) << 20U) |
                     static_cast<std::uint64_t>(z + 4096);
    return sigma * rt::Random(rt::mix64(77, key), static_cast<std::uint64_t>(frame)).normal();
  };
  return s;
}

TEST(StreamCases, C11StillHandOnANoisyStream) {
  for (const double sigma : {0.001, 0.003}) {
    double worst_std = 0, worst_j = 0;
    for (const Placement& place : rig::placements()) {
      Rig r(noisy_floor(place, sigma));
      r.run(Path({{0, 0, 0.02}, {0, 0, -0.008}}, 0.1), 0, 0.28);
      r.run([](double) { return Vec3(0, 0, -0.008); }, 0, 0.2);
      const auto rows = r.run([](double) { return Vec3(0, 0, -0.008); }, 0, 2.0);
      std::vector<double> f, height;
      for (const Row& row : rows) {
        f.push_back(row.f.norm());
        EXPECT_TRUE(row.telemetry.in_contact);
      }
      for (int frame = 15; frame < 75; ++frame) height.push_back(surface_height(r, frame));
      const Figures g = rig::figures(rows);
      rig::print("11 noise " + std::to_string(sigma * 1e3).substr(0, 3) + " mm " + place.name, g);
      std::printf("    std F %.3f N, sigma_z %.3f mm, limit %.3f N\n", deviation(f),
                  1e3 * deviation(height), 1.2e3 * deviation(height));
      EXPECT_LE(deviation(f), 1.2 * 1000 * deviation(height)) << place.name;
      EXPECT_LE(g.j, 0.3 + 1e-9) << place.name;
      worst_std = std::max(worst_std, deviation(f));
      worst_j = std::max(worst_j, g.j_raw);
    }
    std::printf("  11 worst at %.0f mm: std F %.3f N, J_raw %.3f N\n", sigma * 1e3, worst_std,
                worst_j);
  }
}

TEST(StreamCases, C12SurfaceStepsUnderAStillHand) {
  for (const double depth : {0.002, 0.008}) {
    for (const double step : {0.005, -0.005}) {
      for (const Placement& place : rig::placements()) {
        Scene s;
        s.solid = [step](const Vec3& p, double t) {
          return solids::floor(p) - (t > 0.5 ? step : 0);
        };
        s.X_WS = place.X_WS;
        Rig r(s);
        r.run(Path({{0, 0, 0.02}, {0, 0, -depth}}, 0.1), 0, 0.3);
        const auto rows = r.run([=](double) { return Vec3(0, 0, -depth); }, 0.3, 1.0);
        const Figures g = rig::figures(rows);
        const double goal = 1000 * std::max(0.0, depth + step);
        double reached = -1;
        int outside = 0;
        for (const Row& row : rows) {
          if (row.t < 0.5) continue;
          if (reached < 0 && std::abs(row.f.norm() - std::min(12.0, goal)) < 0.05) reached = row.t;
          outside += row.p.z() < -0.011 ? 1 : 0;
        }
        rig::print("12 step " + std::to_string(static_cast<int>(step * 1e3)) + " at " +
                       std::to_string(static_cast<int>(depth * 1e3)) + " mm " + place.name,
                   g);
        // The first window that holds the step is published at 0.533 s at the latest.
        const double published = std::ceil(0.5 * 30 + 1e-6) / 30;
        EXPECT_GE(reached, 0) << place.name;
        EXPECT_LE(reached - published, 0.05) << place.name;
        EXPECT_LE(g.j, 0.3 + 1e-9);
        EXPECT_EQ(outside, 0);
      }
    }
  }
}

TEST(StreamCases, C13SurfaceRises) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double t) {
      return solids::floor(p) - 0.1 * std::clamp(t - 0.5, 0.0, 0.2);
    };
    s.X_WS = place.X_WS;
    s.config.stiffness_N_per_m = 400;  // 20 mm of rise stay below the force limit
    Rig r(s);
    r.run(Path({{0, 0, 0.02}, {0, 0, -0.004}}, 0.1), 0, 0.3);
    const auto rows = r.run([](double) { return Vec3(0, 0, -0.004); }, 0.3, 1.0);
    const Figures g = rig::figures(rows);
    double lag = 0;
    for (const Row& row : rows) {
      EXPECT_TRUE(row.telemetry.in_contact);
      if (row.t > 0.58 && row.t < 0.69) lag = std::max(lag, row.t - 0.5 - row.p.z() / 0.1);
    }
    rig::print("13 rise 100 mm/s " + place.name, g);
    std::printf("    lag behind the true surface %.0f ms (a frame's wait and the blend)\n",
                1e3 * lag);
    EXPECT_LE(g.j, 0.15);
    EXPECT_LE(lag, 0.034 + 0.040);  // the newest frame is up to one period old when it is taken
    EXPECT_NEAR(rows.back().f.norm(), 400 * 0.024, 0.05);
  }
}

TEST(StreamCases, C14ObjectVanishes) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double t) { return t > 0.5 ? 1.0 : solids::floor(p); };
    s.X_WS = place.X_WS;
    Rig r(s);
    r.run(Path({{0, 0, 0.02}, {0, 0, -0.008}}, 0.1), 0, 0.3);
    const auto rows = r.run([](double) { return Vec3(0, 0, -0.008); }, 0.3, 0.8);
    double first = 0, last = 0, previous = 8;
    bool monotonic = true;
    for (const Row& row : rows) {
      const double f = row.f.norm();
      monotonic = monotonic && f <= previous + 2e-3;  // one unit of the patch is 1.5 um
      previous = f;
      if (f > 7.95) first = row.t;
      if (f > 1e-9) last = row.t;
    }
    const Figures g = rig::figures(rows);
    rig::print("14 vanishes " + place.name, g);
    EXPECT_TRUE(monotonic);
    EXPECT_LE(g.j, 0.5);
    EXPECT_GE(last - first, 0.02);
    EXPECT_LE(last - first, 0.06);
    EXPECT_EQ(rows.back().f.norm(), 0);
  }
}

TEST(StreamCases, C16OverTheEdgeOfTheObserved) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::floor(p); };
    s.seen = [](const Vec3& p) { return p.x() < 0.02; };
    s.X_WS = place.X_WS;
    Rig r(s);
    const Path path({{-0.04, 0, 0.01},
                     {-0.04, 0, -0.008},
                     {0.06, 0, -0.008},
                     {-0.04, 0, -0.008},
                     {-0.04, 0, 0.01}},
                    0.1);
    const auto rows = r.run(path, 0, path.duration());
    const Figures g = rig::figures(rows);
    double lateral = 0;
    int held = 0;
    for (const Row& row : rows) {
      lateral = std::max(lateral, std::hypot(row.f.x(), row.f.y()));
      held += row.telemetry.held ? 1 : 0;
    }
    rig::print("16 border " + place.name, g);
    EXPECT_LE(lateral, 0.2);
    EXPECT_LE(g.j, 0.3);
    EXPECT_GT(held, 500);
  }
}

TEST(StreamCases, C16ComingFromTheUnknownGivesNoForce) {
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

TEST(StreamCases, C17StartInsideFadesIn) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::floor(p); };
    s.X_WS = place.X_WS;
    Rig r(s);
    const auto rows = r.run([](double) { return Vec3(0, 0, -0.008); }, 0, 0.3);
    const Figures g = rig::figures(rows);
    rig::print("17 start inside " + place.name, g);
    double full = -1;
    for (const Row& row : rows) {
      EXPECT_GE(row.f.z(), -1e-9);
      if (full < 0 && row.f.z() > 7.95) full = row.t;
    }
    EXPECT_LE(rows.front().f.norm(), 0.3);
    EXPECT_LE(g.j, 0.3);
    EXPECT_GE(full, 0.03);
    EXPECT_LE(full, 0.1);
  }
}

TEST(StreamCases, C17ReenableInsideFadesInOnTheSameSide) {
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::plate(p, 0.02); };
  Rig r(s);
  r.run(Path({{0, 0, 0.02}, {0, 0, -0.005}}, 0.1), 0, 0.26);  // through the middle of the plate
  r.in().stylus.state = drivers::DeviceState::kBrake;
  for (int i = 0; i < 50; ++i) EXPECT_EQ(r.tick({0, 0, -0.005}).f.norm(), 0);
  r.in().stylus.state = drivers::DeviceState::kForce;
  const auto rows = r.run([](double) { return Vec3(0, 0, -0.005); }, 0, 0.15);
  EXPECT_LE(rig::figures(rows).j, 0.34);
  EXPECT_LE(rows.front().f.norm(), 0.31);
  EXPECT_NEAR(rows.back().f.z(), 12, 1e-6);  // 15 mm below the upper face, cut
}

}  // namespace
