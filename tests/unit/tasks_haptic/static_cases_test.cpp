// Hard cases on solids that stand still: force and position against the field optimum, smoothness,
// side. Every case runs at three rotations and three offsets of the grid and prints its figures.
//
// Limits: J <= 0.14 N on planes (1.2 K |dh| + 0.02), at creases and curved faces of a 10 mm field
// 0.33 N with the guard in use in at most 6 % of the contact ticks; |F - F_opt| p95 <= 0.3 N,
// |p - p_opt| p95 <= 0.5 mm; a contact never sits more than 0.5 mm below the field's surface.
// A figure that a case does not meet is printed with "NOT MET" and the field optimum's own figure
// beside.
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
constexpr double kPlaneJ = 0.14, kCreaseJ = 0.33;

struct Result {
  std::vector<Row> rows;
  Figures figures;
  std::vector<rig::Optimum> optimum;
};

Result run(const std::string& name, Scene scene, const Path& path, std::size_t stride = 5) {
  Rig r(std::move(scene));
  Result out;
  out.rows = r.run(path, 0, path.duration());
  out.figures = rig::figures(out.rows);
  out.optimum = rig::score(r, out.rows, out.figures, stride);
  rig::print(name, out.figures);
  const Figures& f = out.figures;
  EXPECT_LE(f.below_max, 0.5e-3) << name;
  EXPECT_LE(f.force_max, 12 + 1e-9) << name;
  EXPECT_LE(f.guard_share, 0.06) << name;
  EXPECT_LE(f.j, kCreaseJ) << name;
  return out;
}

void expect_optimal(const Figures& f, const std::string& name) {
  EXPECT_LE(f.f_error_p95, 0.3) << name;
  EXPECT_LE(f.p_error_p95, 0.5e-3) << name;
}

Scene scene_of(const Placement& place, std::function<double(const Vec3&)> solid) {
  Scene s;
  s.solid = [solid = std::move(solid)](const Vec3& p, double) { return solid(p); };
  s.X_WS = place.X_WS;
  return s;
}

double angle_deg(const Vec3& f, const Vec3& n) {
  return std::acos(std::clamp(f.dot(n) / f.norm(), -1.0, 1.0)) * 180 / std::numbers::pi;
}

TEST(StaticCases, C01FloorSlide) {
  for (const double speed : {0.02, 0.1, 0.2}) {
    for (const Placement& place : rig::placements()) {
      const Path path({{-0.05, 0, 0.002}, {-0.05, 0, -0.008}, {0.05, 0, -0.008}, {0.05, 0, 0.002}},
                      speed);
      const std::string name =
          "1 floor " + std::to_string(static_cast<int>(speed * 1e3)) + "mm/s " + place.name;
      const Result r = run(name, scene_of(place, solids::floor), path, speed < 0.05 ? 50 : 5);
      EXPECT_LE(r.figures.j, std::max(0.12, 1.2 * 1000 * speed * 1e-3 + 0.02)) << name;
      expect_optimal(r.figures, name);
      double chatter = 0;
      int n = 0;
      for (std::size_t i = 1; i + 1 < r.rows.size(); ++i) {
        const Row& row = r.rows[i];
        if (!row.telemetry.in_contact || row.h.z() > -0.00799) continue;
        EXPECT_LE(std::hypot(row.f.x(), row.f.y()), 0.03) << name << " t " << row.t;
        EXPECT_NEAR(row.p.z(), 0, 0.05e-3) << name;
        // What is left above 100 Hz while the depth is held: second differences.
        const Vec3 d = r.rows[i + 1].f - 2 * row.f + r.rows[i - 1].f;
        if (r.rows[i + 1].h.z() < -0.00799 && r.rows[i - 1].h.z() < -0.00799) {
          chatter += d.squaredNorm() / 4;
          ++n;
        }
      }
      EXPECT_LE(std::sqrt(chatter / n), 0.02) << name;
    }
  }
}

TEST(StaticCases, C02ConcaveCorner) {
  for (const Placement& place : rig::placements()) {
    const Path path({{-0.05, 0, 0.005},
                     {-0.05, 0, -0.008},
                     {0.008, 0, -0.008},
                     {0.008, 0.03, -0.008},
                     {0.008, 0.03, 0.05},
                     {-0.01, 0.03, 0.05}},
                    kSpeed);
    const std::string name = "2 concave corner " + place.name;
    const Result r = run(name, scene_of(place, solids::concave_edge), path);
    expect_optimal(r.figures, name);
    double truth = 0;
    Vec3 corner = Vec3::Zero();
    for (const Row& row : r.rows) {
      if (row.telemetry.in_contact) truth = std::max(truth, std::abs(solids::concave_edge(row.p)));
      if (row.h.y() > 0.0149 && row.h.y() < 0.0151) corner = row.f_raw;
    }
    double truth_optimum = 0;
    for (const auto& o : r.optimum) {
      truth_optimum = std::max(truth_optimum, std::abs(solids::concave_edge(o.p)));
    }
    std::printf(
        "    off the true shape %.2f mm, field optimum %.2f mm%s; in the corner F (%.2f, %.2f) N, "
        "true "
        "shape (-8, 8)\n",
        1e3 * truth, 1e3 * truth_optimum, truth > 3e-3 ? "  NOT MET (3)" : "", corner.x(),
        corner.z());
    EXPECT_LE(truth, std::max(3e-3, truth_optimum + 0.1e-3)) << name;
    if (place.name == "0deg/0") {  // the samples hold this shape exactly
      EXPECT_NEAR(corner.x(), -8, 0.4);
      EXPECT_NEAR(corner.z(), 8, 0.4);
    }
  }
}

// Print-only but for the general limits: this case is not among those this version claims.
TEST(StaticCases, C04GroovePrinted) {
  for (const Placement& place : rig::placements()) {
    std::vector<Vec3> points{{0, 0, 0.03}, {0, 0, -0.004}};
    for (int i = 0; i < 2; ++i) {
      points.insert(points.end(), {{0.004, 0, -0.004}, {-0.004, 0.01, -0.004}});
    }
    const std::string name = "4 groove " + place.name;
    const Result r =
        run(name,
            scene_of(place, [](const Vec3& p) { return solids::groove(p, std::numbers::pi / 4); }),
            Path(points, kSpeed));
    EXPECT_LE(r.figures.longer_max, 0.1e-3)
        << name;  // never farther from the hand than the optimum
  }
}

TEST(StaticCases, C05RoomCorner) {
  for (const Placement& place : rig::placements()) {
    const Path path({{-0.04, -0.04, 0.01},
                     {-0.04, -0.04, -0.006},
                     {0.006, 0.006, -0.006},
                     {0.006, 0.006, 0.03},
                     {-0.01, -0.01, 0.03},
                     {0.006, 0.006, -0.006},
                     {-0.02, -0.02, 0.01}},
                    kSpeed);
    const std::string name = "5 room corner " + place.name;
    const Result r = run(name, scene_of(place, solids::room_corner), path);
    // Vertical edge along z, rotated off the axes, apex exactly on a node: the samples make sharp
    // teeth along the edge in which the optimum itself stays for good; the proxy gets out of them.
    const bool toothed = place.name == "17deg/0" || place.name == "45deg/0";
    if (toothed) {
      EXPECT_GT(r.figures.shorter_max, 1e-3) << name << ": the field optimum is caught no more?";
    } else {
      expect_optimal(r.figures, name);
    }
    EXPECT_LE(r.figures.longer_max, 0.1e-3) << name;
    // Release: once the hand has left all three walls by 0.2 mm the contact ends within two ticks.
    int late = 0, run_of = 0;
    for (const Row& row : r.rows) {
      run_of = row.telemetry.in_contact && solids::room_corner(row.h) > 3.5e-3 ? run_of + 1 : 0;
      late = std::max(late, run_of);
    }
    std::printf("    longest contact with the hand 3.5 mm clear of every wall: %d ticks%s\n", late,
                late > 2 ? "  NOT MET (2)" : "");
    if (!toothed) {
      EXPECT_LE(late, 2) << name;
    }
  }
}

TEST(StaticCases, C06ConvexEdgeSlideOff) {
  for (const Placement& place : rig::placements()) {
    const Path path({{-0.06, 0, 0.005}, {-0.06, 0, -0.008}, {0.03, 0, -0.008}}, kSpeed);
    const std::string name = "6 convex edge " + place.name;
    const Result r = run(name, scene_of(place, solids::convex_edge), path);
    expect_optimal(r.figures, name);
    EXPECT_LE(r.figures.j, 0.3 + 1e-9) << name;
    double first = 1, first_optimum = 1;
    int entries = 0;
    for (std::size_t i = 1; i < r.rows.size(); ++i) {
      const Row& row = r.rows[i];
      entries += row.telemetry.in_contact && !r.rows[i - 1].telemetry.in_contact ? 1 : 0;
      if (row.h.z() > -0.00799) continue;
      if (std::hypot(row.f_raw.x(), row.f_raw.y()) > 0.3) first = std::min(first, row.h.x());
    }
    for (const auto& o : r.optimum) {
      const Row& row = r.rows[o.row];
      if (row.h.z() < -0.00799 && std::hypot(o.f.x(), o.f.y()) > 0.3) {
        first_optimum = std::min(first_optimum, row.h.x());
      }
    }
    std::printf(
        "    lateral force above 0.3 N from %.1f mm before the edge, field optimum %.1f mm%s\n",
        -1e3 * std::min(first, 0.0), -1e3 * std::min(first_optimum, 0.0),
        first < -0.002 ? "  NOT MET (2)" : "");
    EXPECT_EQ(entries, 1) << name << ": re-entry";
    EXPECT_GE(first, std::min(first_optimum, 0.0) - 1e-3) << name << ": earlier than the optimum";
  }
}

TEST(StaticCases, C07ConvexEdgePress) {
  for (const Placement& place : rig::placements()) {
    const Path path({{-0.012, 0, 0.01}, {-0.012, 0, -0.03}, {-0.012, 0, 0.01}}, kSpeed);
    const std::string name = "7 press in the rim " + place.name;
    const Result r = run(name, scene_of(place, solids::convex_edge), path);
    double turned = 0, turned_optimum = 0, size = 0;
    for (const Row& row : r.rows) {
      if (row.h.z() > -0.001) continue;
      turned = std::max(turned, angle_deg(row.f, Vec3::UnitZ()));
      size = std::max(size, std::abs(row.f.norm() - std::min(12.0, -1000 * row.h.z())));
    }
    for (const auto& o : r.optimum) {
      if (r.rows[o.row].h.z() < -0.001) {
        turned_optimum = std::max(turned_optimum, angle_deg(o.f, Vec3::UnitZ()));
      }
    }
    const bool met = turned <= 5;
    std::printf("    turned by %.1f deg, field optimum %.1f deg; | |F| - min(K d, 12) | %.2f N%s\n",
                turned, turned_optimum, size, met ? "" : "  NOT MET (5 deg)");
    if (turned_optimum <= 5) {  // else the sampled rim itself lets the hand slip off the side
      EXPECT_LE(turned, 5) << name;
      EXPECT_LE(size, 0.3) << name;
      EXPECT_LE(r.figures.j, kPlaneJ) << name;
      expect_optimal(r.figures, name);
    } else {
      EXPECT_LE(r.figures.p_error_p95, 0.5e-3) << name;
    }
  }
}

// 20 mm is claimed; 10 mm and 6 mm are printed: below two voxels a sampled field hardly holds a
// plate.
TEST(StaticCases, C08Plates) {
  for (const double thickness : {0.020, 0.010, 0.006}) {
    for (const Placement& place : rig::placements()) {
      const double top = thickness / 2, deep = top - 0.8 * thickness;
      const Path path({{0, 0, top + 0.01}, {0, 0, deep}, {0, 0, top + 0.01}}, kSpeed);
      const std::string name =
          "8 plate " + std::to_string(static_cast<int>(thickness * 1e3)) + " mm " + place.name;
      const Result r = run(
          name, scene_of(place, [=](const Vec3& p) { return solids::plate(p, thickness); }), path);
      double least = 0, most = 0;
      for (const Row& row : r.rows) {
        least = std::min(least, row.f.z());
        most = std::max(most, row.f.z());
      }
      const double right = std::min(12.0, 800 * thickness);
      if (thickness > 0.015) {
        EXPECT_GE(least, -1e-6) << name << ": pushed through";
        EXPECT_NEAR(most, right, 0.1) << name;
        EXPECT_LE(r.figures.j, kPlaneJ) << name;
      } else if (most < right - 0.5) {
        std::printf("    held %.1f N where %.1f N is right, least %.2f N  NOT MET\n", most, right,
                    least);
      }
    }
  }
}

TEST(StaticCases, C10Saddle) {
  for (const Placement& place : rig::placements()) {
    std::vector<Vec3> points{{-0.04, -0.02, 0.02}};
    const auto at = [](double x, double y) { return Vec3(x, y, 6 * (x * x - y * y) - 0.008); };
    for (int i = 0; i <= 80; ++i) points.push_back(at(-0.04 + 1e-3 * i, 0.5 * (-0.04 + 1e-3 * i)));
    const std::size_t loop = points.size();
    for (int i = 0; i <= 72; ++i) {  // a closed loop on the sheet 8 mm below
      const double a = 2 * std::numbers::pi * i / 72;
      points.push_back(at(0.02 + 0.02 * std::cos(a), 0.02 * std::cos(a - 1.5707963) + 0.02));
    }
    const std::string name = "10 saddle " + place.name;
    const Path path(points, kSpeed),
        before(std::vector<Vec3>(points.begin(),
                                 points.begin() + static_cast<std::ptrdiff_t>(loop) + 1),
               kSpeed);
    const Result r =
        run(name, scene_of(place, [](const Vec3& p) { return solids::saddle(p, 6); }), path);
    expect_optimal(r.figures, name);
    double truth = 0, curl = 0, curl_raw = 0;
    for (std::size_t i = 1; i < r.rows.size(); ++i) {
      const Row &row = r.rows[i], &last = r.rows[i - 1];
      if (row.telemetry.in_contact && row.t > 0.5) {
        truth = std::max(truth, std::abs(solids::saddle(row.p, 6)));
      }
      if (row.t > before.duration() + 1e-9) {
        curl += 0.5 * (row.f + last.f).dot(row.h - last.h);
        curl_raw += 0.5 * (row.f_raw + last.f_raw).dot(row.h - last.h);
      }
    }
    std::printf(
        "    off the true saddle %.2f mm; closed loop %.3f mJ, before the guard %.3f mJ%s\n",
        1e3 * truth, 1e3 * curl, 1e3 * curl_raw, std::abs(curl) > 0.2e-3 ? "  NOT MET (0.2)" : "");
    EXPECT_LE(truth, 0.3e-3) << name;
  }
}

TEST(StaticCases, C15DeepPress) {
  for (const Placement& place : rig::placements()) {
    const Path path({{0, 0, 0.01}, {0, 0, -0.06}, {0, 0, 0.01}}, kSpeed);
    const std::string name = "15 deep press " + place.name;
    const Result r = run(name, scene_of(place, solids::floor), path);
    EXPECT_LE(r.figures.j, kPlaneJ) << name;
    expect_optimal(r.figures, name);
    for (const Row& row : r.rows) {
      if (row.h.z() < -0.0125) {
        EXPECT_NEAR(row.f.z(), 12, 1e-3) << name;
        EXPECT_LE(angle_deg(row.f, Vec3::UnitZ()), 1) << name;
      }
    }
    EXPECT_FALSE(r.rows.back().telemetry.in_contact);
  }
}

// A finite tip: the constraint is field >= radius, whatever the slope of the field.
TEST(StaticCases, TipRadius) {
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
TEST(StaticCases, BaselinesLoseThePlateThatTheProxyHolds) {
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

}  // namespace
