// Hard cases on solids that stand still: force, position, smoothness (numbers of the case table).
#include <gtest/gtest.h>

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

constexpr double kSpeed = 0.1;

struct Result {
  std::vector<Row> rows;
  Figures figures;
};

Result run(const std::string& name, Scene setup, const Path& path, bool scored = true) {
  Rig r(std::move(setup));
  Result out;
  out.rows = r.run(path, 0, path.duration());
  out.figures = rig::figures(out.rows);
  if (scored) rig::score(r, out.rows, out.figures);
  rig::print(name, out.figures);
  if (std::getenv("RIG_JUMPS") != nullptr) {
    for (const Row& row : out.rows) {
      if (row.telemetry.step_raw_N > 0.25) {
        std::printf(
            "   jump t %.3f h %.2f %.2f %.2f p %.3f %.3f %.3f raw %.3f work %d n %d held %d\n",
            row.t, 1e3 * row.h.x(), 1e3 * row.h.y(), 1e3 * row.h.z(), 1e3 * row.p.x(),
            1e3 * row.p.y(), 1e3 * row.p.z(), row.telemetry.step_raw_N, row.telemetry.work,
            row.contacts, row.telemetry.held);
      }
    }
  }
  return out;
}

TEST(StaticCases, C01FloorSlide) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::floor(p); };
    s.X_WS = place.X_WS;
    const Path path({{-0.05, 0, 0.01}, {-0.05, 0, -0.008}, {0.05, 0, -0.008}, {0.05, 0, 0.01}},
                    kSpeed);
    const Result r = run("1 floor " + place.name, s, path);
    EXPECT_LE(r.figures.j, 0.14);
    EXPECT_LE(r.figures.f_error_p95, 0.3);
    EXPECT_LE(r.figures.p_error_p95, 0.5e-3);
    for (const Row& row : r.rows) {
      if (!row.telemetry.in_contact || row.h.z() > -0.0079) continue;
      EXPECT_LE(std::hypot(row.f.x(), row.f.y()), 0.03)
          << row.t << " p " << 1e3 * row.p.transpose() << " h " << 1e3 * row.h.transpose()
          << " work " << row.telemetry.work << " n " << row.contacts << " guard "
          << row.telemetry.guard_active;
      EXPECT_NEAR(row.p.z(), 0, 0.05e-3);
      EXPECT_NEAR(row.f.z(), 8, 0.05);
    }
  }
}

TEST(StaticCases, C02ConcaveCorner) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::concave_edge(p); };
    s.X_WS = place.X_WS;
    const Path path({{-0.05, 0, 0.005},
                     {-0.05, 0, -0.008},
                     {0.008, 0, -0.008},
                     {0.008, 0.03, -0.008},
                     {0.008, 0.03, 0.05},
                     {-0.01, 0.03, 0.05}},
                    kSpeed);
    const Result r = run("2 concave corner " + place.name, s, path);
  }
}

TEST(StaticCases, C05RoomCorner) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::room_corner(p); };
    s.X_WS = place.X_WS;
    const Path path({{-0.04, -0.04, 0.01},
                     {-0.04, -0.04, -0.006},
                     {0.006, 0.006, -0.006},
                     {0.006, 0.006, 0.03},
                     {-0.01, -0.01, 0.03},
                     {0.006, 0.006, -0.006},
                     {-0.02, -0.02, 0.01}},
                    kSpeed);
    const Result r = run("5 room corner " + place.name, s, path);
  }
}

TEST(StaticCases, C06ConvexEdgeSlideOff) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::convex_edge(p); };
    s.X_WS = place.X_WS;
    const Path path({{-0.06, 0, 0.005}, {-0.06, 0, -0.008}, {0.03, 0, -0.008}}, kSpeed);
    const Result r = run("6 convex edge " + place.name, s, path);
    double first = 1;
    for (const Row& row : r.rows) {
      if (row.h.z() <= -0.0079 && std::hypot(row.f.x(), row.f.y()) > 0.3)
        first = std::min(first, row.h.x());
    }
    std::printf("    lateral > 0.3 N from x = %.2f mm\n", 1e3 * first);
  }
}

TEST(StaticCases, C07ConvexEdgePress) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::convex_edge(p); };
    s.X_WS = place.X_WS;
    const Path path({{-0.012, 0, 0.01}, {-0.012, 0, -0.03}, {-0.012, 0, 0.01}}, kSpeed);
    const Result r = run("7 press in the rim " + place.name, s, path);
  }
}

TEST(StaticCases, C08Plates) {
  for (const double thickness : {0.020, 0.010, 0.006}) {
    for (const Placement& place : rig::placements()) {
      Scene s;
      s.solid = [thickness](const Vec3& p, double) { return solids::plate(p, thickness); };
      s.X_WS = place.X_WS;
      const double deep = thickness / 2 - 0.8 * thickness;
      const Path path({{0, 0, thickness / 2 + 0.01}, {0, 0, deep}, {0, 0, thickness / 2 + 0.01}},
                      kSpeed);
      const Result r =
          run("8 plate " + std::to_string(static_cast<int>(thickness * 1e3)) + " mm " + place.name,
              s, path);
    }
  }
}

TEST(StaticCases, C10Saddle) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::saddle(p, 6); };
    s.X_WS = place.X_WS;
    std::vector<Vec3> points{{-0.04, 0, 0.02}};
    for (int i = 0; i <= 80; ++i) {
      const double x = -0.04 + 0.001 * i;
      points.push_back({x, 0.5 * x, 6 * (x * x - 0.25 * x * x) - 0.008});
    }
    const Result r = run("10 saddle " + place.name, s, Path(points, kSpeed));
  }
}

TEST(StaticCases, C04Groove) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::groove(p, std::numbers::pi / 4); };
    s.X_WS = place.X_WS;
    std::vector<Vec3> points{{0, 0, 0.03}, {0, 0, -0.004}};
    for (int i = 0; i < 4; ++i)
      points.insert(points.end(), {{0.004, 0, -0.004}, {-0.004, 0.01, -0.004}});
    const Result r = run("4 groove " + place.name, s, Path(points, kSpeed));
  }
}

TEST(StaticCases, C15DeepPress) {
  for (const Placement& place : rig::placements()) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::floor(p); };
    s.X_WS = place.X_WS;
    const Path path({{0, 0, 0.01}, {0, 0, -0.06}, {0, 0, 0.01}}, kSpeed);
    const Result r = run("15 deep press " + place.name, s, path);
  }
}

}  // namespace
