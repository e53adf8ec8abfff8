// Cases with friction.
#include <cstdio>

#include "tests/support/haptic_solids.hpp"
#include "tools/stability/cases.hpp"

namespace stability {

using rig::Path;
using rig::Row;
using rig::Scene;
using rig::Vec3;

namespace {

std::string text(const char* format, auto... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

Scene rough(const Setting& s, std::function<double(const Vec3&)> solid) {
  Scene scene = still_scene(s, std::move(solid));
  scene.config.friction_static = 0.3;
  scene.config.friction_dynamic = 0.24;
  return scene;
}

}  // namespace

std::vector<Run> case_friction_corner(const Setting& s) {
  const Path path({{-0.05, 0, 0.005},
                   {-0.05, 0, -0.008},
                   {0.008, 0, -0.008},
                   {0.008, 0.03, -0.008},
                   {0.008, 0.03, 0.05}},
                  s.speed);
  Setting unjudged = s;
  unjudged.judged = false;  // the optimum knows no friction
  Run run =
      slide(3, "", unjudged, rough(s, solids::concave_edge), path, {.j = 0.25, .crease = true});
  double drop = 0, most = 0;
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    const double f = run.rows[i].telemetry.friction_N,
                 before = run.rows[i - 1].telemetry.friction_N;
    most = std::max(most, f);
    // Where the second wall is met: the floor bears the hand, the hand is about to reach the wall.
    if (std::abs(run.rows[i].h.x()) < 0.004 && run.rows[i].h.z() < -0.0079 &&
        run.rows[i].h.y() < 1e-9) {
      drop = std::max(drop, before - f);
    }
  }
  add(run, "friction dropped N", drop, 0.1);
  run.note = text("most friction %.2f N, largest drop at the wall %.3f N", most, drop);
  return {run};
}

std::vector<Run> case_friction_hold(const Setting& s) {
  rig::Rig r(rough(s, solids::floor));
  // Input of an encoder: 10 um steps, and a hand that trembles by one of them.
  const auto quantum = [](const Vec3& p) {
    return Vec3(1e-5 * std::round(p.x() / 1e-5), 1e-5 * std::round(p.y() / 1e-5),
                1e-5 * std::round(p.z() / 1e-5));
  };
  const Path down({{0, 0, 0.01}, {0, 0, -0.008}}, s.speed);
  r.run([&](double t) { return quantum(down(t)); }, 0, down.duration());
  // To 60 % of the cone: 0.6 x 0.3 x 8 mm = 1.44 mm.
  const Path aside({{0, 0, -0.008}, {0.00144, 0, -0.008}}, s.speed);
  r.run([&](double t) { return quantum(aside(t)); }, 0, aside.duration());
  Run run;
  run.id = 18;
  run.name = title("", s);
  run.rows = r.run(
      [&](double t) { return quantum(Vec3(0.00144 + 6e-6 * std::sin(7 * t), 0, -0.008)); }, 0, 10);
  double creep = 0;
  for (const Row& row : run.rows) creep = std::max(creep, (row.p - run.rows[0].p).norm());
  // Then a slide, and back.
  const Path slide_on({{0.00144, 0, -0.008}, {0.03, 0, -0.008}, {0.01, 0, -0.008}}, s.speed);
  const double turn = 0.02856 / s.speed;
  auto rows = r.run([&](double t) { return quantum(slide_on(t)); }, 0, slide_on.duration());
  double slip = 0, reversal = 0, sliding = 0;
  const double from = rows.front().t;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    // Before any guard while it slides on; what the hand gets while it turns and breaks loose again.
    const double t = rows[i].t - from;
    if (t < turn - 0.002) {
      slip = std::max(slip, (rows[i].f_raw - rows[i - 1].f_raw).norm());
    } else {
      reversal = std::max(reversal, (rows[i].f - rows[i - 1].f).norm());
    }
    if (t < turn && rows[i].h.x() > 0.02) sliding = rows[i].telemetry.friction_N;
  }
  run.rows.insert(run.rows.end(), rows.begin(), rows.end());
  run.figures = rig::figures(run.rows);
  add_gates(run);
  add(run, "creep mm", 1e3 * creep, 0.05);
  add(run, "slip step N", slip, std::max(0.58, 1.2 * 1000 * s.speed * 1e-3 + 0.02));
  add(run, "reversal step N", reversal, std::max(0.3, 1.2 * 1000 * s.speed * 1e-3 + 0.02));
  add(run, "slide friction error N", std::abs(sliding - 0.24 * 8), 0.1);
  return {run};
}

}  // namespace stability
