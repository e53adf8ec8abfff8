// Cases on solids that are narrower than their samples: a groove, plates, slots.
#include <algorithm>
#include <numbers>

#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

constexpr int kMostIterations = 10;
constexpr double kGrooveAngle = std::numbers::pi / 4, kGrooveDepth_m = 0.004;

double groove_solid(const Vec3& p) { return solids::groove(p, kGrooveAngle); }

// Ticks of the same way in which a proxy that may take ten steps a tick is not where one is that
// takes all it needs.
int ticks_over(int iterations, const Setting& s, const Path& path, const std::vector<Row>& rows) {
  Scene scene = still_scene(s, groove_solid);
  scene.config.iterations_max = iterations;
  rig::Rig r(std::move(scene));
  int over = 0;
  for (const Row& row : rows) over += (r.tick(path(row.t)).p - row.p).norm() > 1e-6 ? 1 : 0;
  return over;
}

// RMS above 100 Hz of a hand that rests for 0.4 s at either end and in the middle of the swing.
double rest_chatter_N(rig::Rig& r, const Vec3& from, double speed) {
  constexpr double kRest_s = 0.4;
  Vec3 last = from;
  double most = 0;
  for (const double x : {-0.004, 0.0, 0.004}) {
    const Vec3 to(x, from.y(), from.z());
    const Path there({last, to}, speed);
    r.run(there, 0, there.duration() + 0.1);
    const std::vector<Row> rest = r.run([&](double) { return Vec3(to); }, 0, kRest_s);
    most = std::max(most, chatter_N(forces_of(rest)));
    last = to;
  }
  return most;
}

// Where a round tip's centre rests.
double apex_m(const Setting& s) { return s.tip_radius_m / std::sin(kGrooveAngle / 2); }

Path swing(const Setting& s) {
  const double z = apex_m(s) - kGrooveDepth_m;
  std::vector<Vec3> points{{0, 0, 0.03 + apex_m(s)}, {0, 0, z}};
  for (int i = 0; i < 2; ++i) points.insert(points.end(), {{0.004, 0, z}, {-0.004, 0.01, z}});
  return Path(points, s.speed);
}

std::vector<Run> groove_runs(const Setting& s) {
  const double apex = apex_m(s), z = apex - kGrooveDepth_m;
  const Path path = swing(s);
  std::vector<Vec3> line;
  double chatter = 0;
  Run run = slide(4, "", s, still_scene(s, groove_solid), path, {.crease = true},
                  [&](rig::Rig& r, const Run& done) {
                    line = groove_line(r, done.rows, 0.02 + apex);
                    chatter = rest_chatter_N(r, done.rows.back().h, s.speed);
                  });
  const auto deep = [=](const Vec3& h) { return h.z() < z + 1e-5; };
  const Worst off = worst_of(run, s, [&](const Vec3& h, const Vec3& p, const Vec3&) {
    return deep(h) ? 1e3 * off_line_m(line, p) : 0.0;
  });
  const Worst peak =
      worst_of(run, s, [](const Vec3&, const Vec3&, const Vec3& f) { return f.norm(); });
  add(run, "off the groove line mm", off, 1.5);
  add(run, "rest chatter N", chatter, 0.02);
  if (s.method == "constrained") {
    add(run, "ticks of more than 10 iterations", ticks_over(kMostIterations, s, path, run.rows), 0);
  }
  run.note = text("peak %.2f N (optimum %.2f), true shape 5.7; off the groove line %.2f mm (%.2f)",
                  peak.ours, peak.optimum, off.ours, off.optimum);
  return {run};
}

std::vector<Run> plate_runs(const Setting& s) {
  std::vector<Run> out;
  for (const double thickness : {0.020, 0.010, 0.006}) {
    const double top = thickness / 2 + raised_m(s), deep = top - 0.8 * thickness;
    const Path path({{0, 0, top + 0.01}, {0, 0, deep}, {0, 0, top + 0.01}}, s.speed);
    Run run = slide(8, text("%.0f mm", 1e3 * thickness), s,
                    still_scene(s, [=](const Vec3& p) { return solids::plate(p, thickness); }),
                    path, {.j = 0.12, .crease = true});
    double least = 0, most = 0, most_optimum = 0, least_optimum = 0;
    int flips = 0, flagged = 0;
    for (const Row& row : run.rows) {
      least = std::min(least, row.f.z());
      most = std::max(most, row.f.z());
      flagged += row.telemetry.unresolved ? 1 : 0;
    }
    for (std::size_t i = 1; i < run.rows.size(); ++i) {
      flips += run.rows[i].f.z() * run.rows[i - 1].f.z() < -1e-6 ? 1 : 0;
    }
    for (const auto& o : run.optimum) {
      most_optimum = std::max(most_optimum, o.f.z());
      least_optimum = std::min(least_optimum, o.f.z());
    }
    const double right = std::min(12.0, 800 * thickness);
    const bool excused = thickness < 0.0099 && flagged > 0;  // below a voxel: flagged is enough
    add(run, "side flips", excused ? 0 : flips, 0, least_optimum < -0.1 ? 1 : 0);
    if (!excused) {
      add(run, "missing force N", right - most, 0.3, right - most_optimum);
    }
    run.note = text("held %.1f N of %.1f (optimum %.1f), least %.2f N%s", most, right, most_optimum,
                    least, flagged > 0 ? ", flagged unresolved" : "");
    out.push_back(std::move(run));
  }
  return out;
}

// Solid z < 0 with a slot |x| < width / 2 down to z = -30 mm.
double slot_solid(const Vec3& p, double width) {
  const double side = width / 2 - std::abs(p.x());  // inside the slot: > 0
  const double bottom = p.z() + 0.03;
  const double slot = std::min(side, bottom);
  if (p.z() >= 0) return side > 0 ? std::hypot(side, p.z()) : p.z();
  if (slot > 0) return slot;
  const double into = side < 0 && bottom < 0 ? std::hypot(side, bottom)
                      : side < 0             ? -side
                                             : -bottom;
  return -std::min(into, -p.z());
}

constexpr double kSlotDepth_m = 0.012;

// A tip wider than the slot stays on its two rims, and is pushed out of it.
void add_bridge(Run& run, const Setting& s, double width, double radius) {
  const double over = std::sqrt(radius * radius - 0.25 * width * width);
  const auto deep = [](const Vec3& h) { return h.z() < 1e-4 - kSlotDepth_m; };
  add(run, "sunk into the slot mm",
      worst_of(run, s,
               [&](const Vec3& h, const Vec3& p, const Vec3&) {
                 return deep(h) ? 1e3 * (over - p.z()) : 0.0;
               }),
      1.5);
  add(run, "not pushed out of the slot N",
      worst_of(run, s,
               [&](const Vec3& h, const Vec3&, const Vec3& f) {
                 return deep(h) ? std::min(12.0, -1e3 * h.z()) - f.z() : 0.0;
               }),
      1.5);
}

void add_walls(Run& run, const Setting& s, double width, double radius) {
  const double right = width / 2 - radius;
  add(run, "walls off mm",
      worst_of(run, s,
               [=](const Vec3& h, const Vec3& p, const Vec3&) {
                 return h.z() < 1e-4 - kSlotDepth_m && std::abs(h.x()) > right + 1e-3
                            ? 1e3 * std::abs(std::abs(p.x()) - right)
                            : 0.0;
               }),
      1.5);
}

Run slot_run(const Setting& s, double width) {
  const double radius = s.tip_radius_m;
  const double swing = width / 2 + 0.004, z = -kSlotDepth_m;
  const Path path(
      {{0, 0, 0.012}, {0, 0, z}, {swing, 0, z}, {-swing, 0, z}, {0, 0, z}, {0, 0, 0.012}}, s.speed);
  Run run = slide(9, text("%.0f mm", 1e3 * width), s,
                  still_scene(s, [=](const Vec3& p) { return slot_solid(p, width); }), path,
                  {.j = 0.3, .crease = true});
  if (2 * radius > width) {
    add_bridge(run, s, width, radius);
  } else {
    add_walls(run, s, width, radius);
  }
  add(run, "reversals", reversals(run), 0);
  return run;
}

std::vector<Run> slot_runs(const Setting& s) { return {slot_run(s, 0.010), slot_run(s, 0.005)}; }

}  // namespace

int groove_ticks_over(int iterations, const Setting& s) {
  const Path path = swing(s);
  rig::Rig r(still_scene(s, groove_solid));
  return ticks_over(iterations, s, path, r.run(path, 0, path.duration()));
}

std::vector<Run> case_groove(const Setting& s) { return with_both_tips(s, groove_runs); }
std::vector<Run> case_plates(const Setting& s) { return with_both_tips(s, plate_runs); }
std::vector<Run> case_slots(const Setting& s) { return with_both_tips(s, slot_runs); }

}  // namespace stability
