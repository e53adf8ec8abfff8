// Cases on solids that stand still.
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>

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

// Longest time the contact goes on while the hand is outside and the way to it is free, in ticks.
int release_lag(const rig::Rig& r, const std::vector<Row>& rows) {
  const auto field = rig::reference_field(r, rows);
  int longest = 0, now = 0;
  for (const Row& row : rows) {
    bool free = row.telemetry.in_contact;
    const Vec3 h = r.setup().X_WS * row.h, p = r.setup().X_WS * row.p;
    for (int i = 0; free && i <= 20; ++i) {
      free = field(h + 0.05 * i * (p - h)) > r.setup().config.tip_radius_m + 2e-4 - 1e-5 * i;
    }
    now = free ? now + 1 : 0;
    longest = std::max(longest, now);
  }
  return longest;
}

}  // namespace

std::string title(const std::string& name, const Setting& s) {
  std::string out = name + " " + s.place.name + " " + text("%.0f", 1e3 * s.speed) + "mm/s";
  if (s.fused != nullptr) {
    out += text(", fused at %.0f deg%s, R %.0f mm", s.fused->incidence_deg,
                s.fused->noise ? " with noise" : "", 1e3 * s.tip_radius_m);
  }
  return out;
}

bool on_fused_fields(int id) {
  constexpr int kIds[] = {1, 2, 5, 6, 7, 10, 13};
  return std::ranges::find(kIds, id) != std::end(kIds);
}

std::vector<FusedView> fused_views() {
  std::vector<FusedView> out;
  for (const double angle : {20.0, 45.0, 70.0}) {
    for (const bool noise : {false, true}) {
      FusedView v;
      v.incidence_deg = angle;
      v.noise = noise;
      out.push_back(v);
    }
  }
  return out;
}

void add(Run& run, std::string name, double value, double limit, double optimum) {
  run.checks.push_back({std::move(name), value, limit, optimum});
}

void add_gates(Run& run) {
  double force = 0;
  for (const Row& row : run.rows) {
    force = std::max(force, row.f.allFinite() && row.p.allFinite() ? row.f.norm() : 1e9);
  }
  add(run, "force N", force, 12);
}

double deviation(const std::vector<double>& v) {
  double mean = 0, sum = 0;
  for (const double x : v) mean += x / static_cast<double>(v.size());
  for (const double x : v) sum += (x - mean) * (x - mean);
  return std::sqrt(sum / static_cast<double>(v.size()));
}

double angle_deg(const Vec3& f, const Vec3& n) {
  return std::acos(std::clamp(f.dot(n) / f.norm(), -1.0, 1.0)) * 180 / std::numbers::pi;
}

Scene still_scene(const Setting& s, std::function<double(const Vec3&)> solid, const Vec3& lean) {
  Scene scene;
  if (s.fused != nullptr) {
    FusedView view = *s.fused;
    view.lean_S = lean;
    const auto field = std::make_shared<FusedField>(s.place.X_WS, view);
    for (int i = 0; i < view.frames; ++i) field->see(solid);
    scene.window = [field](const Vec3& centre, int nodes, double, perception::SurfacePatch& out) {
      field->window(centre, nodes, out);
    };
    scene.sampled = [field](int x, int y, int z) { return field->node(x, y, z); };
    scene.known = [field](int x, int y, int z) { return field->known(x, y, z); };
    scene.config.tip_radius_m = s.tip_radius_m;
  }
  scene.solid = [solid = std::move(solid)](const Vec3& p, double) { return solid(p); };
  scene.X_WS = s.place.X_WS;
  scene.still = true;
  scene.config.method = s.method;
  return scene;
}

Run slide(int id, const std::string& name, const Setting& s, Scene scene, const Path& path,
          const Limits& limits) {
  Run run;
  run.id = id;
  run.name = title(name, s);
  const double k = scene.config.stiffness_N_per_m;
  rig::Rig r(std::move(scene));
  run.rows = r.run(path, 0, path.duration());
  run.figures = rig::figures(run.rows);
  const rig::Figures& f = run.figures;
  if (s.judged) {
    // The oracle every 0.1 mm of the hand's way.
    const auto stride =
        static_cast<std::size_t>(std::max(1.0, std::round(0.1e-3 / (1e-3 * s.speed))));
    run.optimum = rig::score(r, run.rows, run.figures, stride);
  }
  add_gates(run);
  const double moving = 1.2 * k * s.speed * 1e-3 + 0.02;
  add(run, "J N", f.j, std::max({limits.j, moving, limits.crease ? 0.33 : 0.0}),
      s.judged ? f.j_optimum : std::numeric_limits<double>::quiet_NaN());
  add(run, "guard use", f.guard_share, 0.06);
  if (s.judged) {
    add(run, "below mm", 1e3 * f.below_max, 0.5);
    if (s.fused == nullptr) {
      add(run, "release lag ticks", release_lag(r, run.rows), 1);
    } else {
      run.note = text(
          "%.0f %% of the ticks in the surface judged by the optimum, the rest in or after unknown "
          "space",
          100 * f.judged_share);
    }
    if (limits.optimum) {
      add(run, "F error p95 N", f.f_error_p95, 0.3, f.f_error_optimum);
      add(run, "p error p95 mm", 1e3 * f.p_error_p95, 0.5);
      add(run, "unused N", f.unused_max, 0.9, f.unused_optimum);
    }
  }
  return run;
}

std::vector<Run> case_floor(const Setting& s) {
  const double above = 0.002 + 3 * s.tip_radius_m;  // a start inside would fade in
  const Path path({{-0.05, 0, above}, {-0.05, 0, -0.008}, {0.05, 0, -0.008}, {0.05, 0, above}},
                  s.speed);
  Run run = slide(1, "", s, still_scene(s, solids::floor), path, {.j = 0.12});
  if (s.fused != nullptr) return {run};
  double tangential = 0, depth = 0, chatter = 0;
  int n = 0;
  const auto deep = [](const Row& row) { return row.h.z() < -0.00799; };
  for (std::size_t i = 1; i + 1 < run.rows.size(); ++i) {
    const Row& row = run.rows[i];
    if (!row.telemetry.in_contact || !deep(row)) continue;
    tangential = std::max(tangential, std::hypot(row.f.x(), row.f.y()));
    depth = std::max(depth, std::abs(row.p.z()));
    if (!deep(run.rows[i - 1]) || !deep(run.rows[i + 1])) continue;
    chatter += (run.rows[i + 1].f - 2 * row.f + run.rows[i - 1].f).squaredNorm() / 4;
    ++n;
  }
  add(run, "tangential N", tangential, 0.03);
  add(run, "depth error mm", 1e3 * depth, 0.05);
  add(run, "chatter N", n > 0 ? std::sqrt(chatter / n) : 0, 0.02);
  return {run};
}

std::vector<Run> case_concave_corner(const Setting& s) {
  const Path path({{-0.05, 0, 0.005},
                   {-0.05, 0, -0.008},
                   {0.008, 0, -0.008},
                   {0.008, 0.03, -0.008},
                   {0.008, 0.03, 0.05},
                   {-0.01, 0.03, 0.05}},
                  s.speed);
  Run run =
      slide(2, "", s, still_scene(s, solids::concave_edge, -Vec3::UnitX()), path, {.crease = true});
  if (s.fused != nullptr) return {run};
  double truth = 0, truth_optimum = 0;
  Vec3 corner = Vec3::Zero();
  for (const Row& row : run.rows) {
    if (row.telemetry.in_contact) truth = std::max(truth, std::abs(solids::concave_edge(row.p)));
    if (std::abs(row.h.y() - 0.015) <= 0.6e-3 * s.speed) corner = row.f_raw;
  }
  for (const auto& o : run.optimum) {
    truth_optimum = std::max(truth_optimum, std::abs(solids::concave_edge(o.p)));
  }
  add(run, "off the true shape mm", 1e3 * truth, 3, 1e3 * truth_optimum);
  if (s.place.name == "0deg/0") {  // the samples hold this shape exactly
    add(run, "corner F N", (corner - Vec3(-8, 0, 8)).norm(), 0.4);
  }
  run.note = text("off the true shape %.2f mm (optimum %.2f); corner F (%.2f, %.2f), true (-8, 8)",
                  1e3 * truth, 1e3 * truth_optimum, corner.x(), corner.z());
  return {run};
}

std::vector<Run> case_groove(const Setting& s) {
  std::vector<Vec3> points{{0, 0, 0.03}, {0, 0, -0.004}};
  for (int i = 0; i < 2; ++i) {
    points.insert(points.end(), {{0.004, 0, -0.004}, {-0.004, 0.01, -0.004}});
  }
  Run run =
      slide(4, "", s,
            still_scene(s, [](const Vec3& p) { return solids::groove(p, std::numbers::pi / 4); }),
            Path(points, s.speed), {.crease = true});
  double peak = 0, peak_optimum = 0;
  for (const Row& row : run.rows) peak = std::max(peak, row.f.norm());
  for (const auto& o : run.optimum) peak_optimum = std::max(peak_optimum, o.f.norm());
  run.note = text("peak %.2f N (optimum %.2f), true shape 5.7", peak, peak_optimum);
  return {run};
}

std::vector<Run> case_room_corner(const Setting& s) {
  const Path path({{-0.04, -0.04, 0.01},
                   {-0.04, -0.04, -0.006},
                   {0.006, 0.006, -0.006},
                   {0.006, 0.006, 0.03},
                   {-0.01, -0.01, 0.03},
                   {0.006, 0.006, -0.006},
                   {-0.02, -0.02, 0.01}},
                  s.speed);
  return {slide(5, "", s, still_scene(s, solids::room_corner, Vec3(-1, -1, 0).normalized()), path,
                {.crease = true})};
}

std::vector<Run> case_convex_edge(const Setting& s) {
  const Path path({{-0.06, 0, 0.005}, {-0.06, 0, -0.008}, {0.03, 0, -0.008}}, s.speed);
  Run run = slide(6, "", s, still_scene(s, solids::convex_edge), path, {.crease = true});
  if (s.fused != nullptr) return {run};
  double first = 0, first_optimum = 0;
  int entries = 0;
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    const Row& row = run.rows[i];
    entries += row.telemetry.in_contact && !run.rows[i - 1].telemetry.in_contact ? 1 : 0;
    if (row.h.z() > -0.00799) continue;
    if (std::hypot(row.f_raw.x(), row.f_raw.y()) > 0.3) first = std::min(first, row.h.x());
  }
  for (const auto& o : run.optimum) {
    const Row& row = run.rows[o.row];
    if (row.h.z() < -0.00799 && std::hypot(o.f.x(), o.f.y()) > 0.3) {
      first_optimum = std::min(first_optimum, row.h.x());
    }
  }
  add(run, "lateral before edge mm", -1e3 * first, 2, -1e3 * first_optimum);
  add(run, "entries", entries, 1);
  return {run};
}

std::vector<Run> case_rim_press(const Setting& s) {
  const Path path({{-0.012, 0, 0.01}, {-0.012, 0, -0.03}, {-0.012, 0, 0.01}}, s.speed);
  Run run = slide(7, "", s, still_scene(s, solids::convex_edge), path, {.crease = true});
  if (s.fused != nullptr) return {run};
  double turned = 0, turned_optimum = 0, size = 0, size_optimum = 0;
  for (const Row& row : run.rows) {
    if (row.h.z() > -0.001) continue;
    if (row.f.norm() > 0.05) turned = std::max(turned, angle_deg(row.f, Vec3::UnitZ()));
    size = std::max(size, std::abs(row.f.norm() - std::min(12.0, -1000 * row.h.z())));
  }
  for (const auto& o : run.optimum) {
    const double z = run.rows[o.row].h.z();
    if (z > -0.001) continue;
    if (o.f.norm() > 0.05) turned_optimum = std::max(turned_optimum, angle_deg(o.f, Vec3::UnitZ()));
    size_optimum = std::max(size_optimum, std::abs(o.f.norm() - std::min(12.0, -1000 * z)));
  }
  add(run, "turned deg", turned, 5, turned_optimum);
  add(run, "size error N", size, 0.4, size_optimum);
  return {run};
}

std::vector<Run> case_plates(const Setting& s) {
  std::vector<Run> out;
  for (const double thickness : {0.020, 0.010, 0.006}) {
    const double top = thickness / 2, deep = top - 0.8 * thickness;
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

std::vector<Run> case_slots(const Setting& s) {
  std::vector<Run> out;
  for (const double width : {0.010, 0.005}) {
    for (const double radius : {0.003, 0.0}) {
      // Solid z < 0 with a slot |x| < width / 2 down to z = -30 mm.
      const auto solid = [=](const Vec3& p) {
        const double side = width / 2 - std::abs(p.x());  // inside the slot: > 0
        const double bottom = p.z() + 0.03;
        const double slot = std::min(side, bottom);
        if (p.z() >= 0) {
          return side > 0 ? std::hypot(side, p.z()) : p.z();
        }
        if (slot > 0) return slot;
        const double into = side < 0 && bottom < 0 ? std::hypot(side, bottom)
                            : side < 0             ? -side
                                                   : -bottom;
        return -std::min(into, -p.z());
      };
      const double swing = width / 2 + 0.004;
      const Path path({{0, 0, 0.012},
                       {0, 0, -0.012},
                       {swing, 0, -0.012},
                       {-swing, 0, -0.012},
                       {0, 0, -0.012},
                       {0, 0, 0.012}},
                      s.speed);
      Scene scene = still_scene(s, solid);
      scene.config.tip_radius_m = radius;
      const bool bridges = 2 * radius > width;
      Run run = slide(9, text("%.0f mm R %.0f mm", 1e3 * width, 1e3 * radius), s, std::move(scene),
                      path, {.j = 0.3, .crease = true});
      double off = 0, off_optimum = 0;
      const auto wall = [&](const Vec3& h, const Vec3& p) {
        const double right = width / 2 - radius;
        return h.z() < -0.0119 && std::abs(h.x()) > right + 1e-3 ? std::abs(std::abs(p.x()) - right)
                                                                 : 0.0;
      };
      for (const Row& row : run.rows) off = std::max(off, wall(row.h, row.p));
      for (const auto& o : run.optimum)
        off_optimum = std::max(off_optimum, wall(run.rows[o.row].h, o.p));
      if (!bridges) add(run, "walls off mm", 1e3 * off, 1.5, 1e3 * off_optimum);
      out.push_back(std::move(run));
    }
  }
  return out;
}

std::vector<Run> case_saddle(const Setting& s) {
  // Fused: the middle of the sheet alone, which a camera at 70 degrees still sees all of.
  const double size = s.fused != nullptr ? 0.35 : 1.0;
  std::vector<Vec3> points{{size * -0.04, size * -0.02, 0.02}};
  const auto at = [size](double x, double y) {
    return Vec3(size * x, size * y, 6 * size * size * (x * x - y * y) - 0.008);
  };
  for (int i = 0; i <= 80; ++i) points.push_back(at(-0.04 + 1e-3 * i, 0.5 * (-0.04 + 1e-3 * i)));
  const std::size_t loop = points.size();
  for (int i = 0; i <= 72; ++i) {  // a closed loop on the sheet 8 mm below
    const double a = 2 * std::numbers::pi * i / 72;
    points.push_back(at(0.02 + 0.02 * std::cos(a), 0.02 * std::sin(a) + 0.02));
  }
  const Path path(points, s.speed),
      before(
          std::vector<Vec3>(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(loop) + 1),
          s.speed);
  // From +y: towards +x and -x the sheet rises above any camera.
  Run run = slide(10, "", s,
                  still_scene(
                      s,
                      [rays = s.fused != nullptr](const Vec3& p) {
                        return rays ? solids::saddle_bound(p, 6) : solids::saddle(p, 6);
                      },
                      Vec3::UnitY()),
                  path, {.j = 0.1, .crease = true});
  if (s.fused != nullptr) return {run};
  double truth = 0, truth_optimum = 0, curl = 0, curl_raw = 0, curl_optimum = 0;
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    const Row &row = run.rows[i], &last = run.rows[i - 1];
    if (row.telemetry.in_contact && row.h.z() < solids::saddle(row.h, 6) + 0.05) {
      truth = std::max(truth, std::abs(solids::saddle(row.p, 6)));
    }
    if (row.t > before.duration() + 1e-9) {
      curl += 0.5 * (row.f + last.f).dot(row.h - last.h);
      curl_raw += 0.5 * (row.f_raw + last.f_raw).dot(row.h - last.h);
    }
  }
  for (std::size_t i = 1; i < run.optimum.size(); ++i) {
    const auto &o = run.optimum[i], &last = run.optimum[i - 1];
    truth_optimum = std::max(truth_optimum, std::abs(solids::saddle(o.p, 6)));
    if (run.rows[last.row].t > before.duration()) {
      curl_optimum += 0.5 * (o.f + last.f).dot(run.rows[o.row].h - run.rows[last.row].h);
    }
  }
  add(run, "off truth mm", 1e3 * truth, 0.3, 1e3 * truth_optimum);
  add(run, "loop energy mJ", 1e3 * std::abs(curl), 0.2, 1e3 * std::abs(curl_optimum));
  run.note = text("loop %.2f mJ, before the guard %.2f", 1e3 * curl, 1e3 * curl_raw);
  return {run};
}

std::vector<Run> case_deep_press(const Setting& s) {
  const Path path({{0, 0, 0.01}, {0, 0, -0.06}, {0, 0, 0.01}}, s.speed);
  Run run = slide(15, "", s, still_scene(s, solids::floor), path, {.j = 0.12});
  double turned = 0, missing = 0;
  for (const Row& row : run.rows) {
    if (row.h.z() > -0.0125) continue;
    missing = std::max(missing, 12 - row.f.z());
    turned = std::max(turned, angle_deg(row.f, Vec3::UnitZ()));
  }
  add(run, "missing force N", missing, 0.01);
  add(run, "turned deg", turned, 1);
  add(run, "still in contact", run.rows.back().telemetry.in_contact ? 1 : 0, 0);
  return {run};
}

std::vector<Run> case_border(const Setting& s) {
  Scene scene = still_scene(s, solids::floor);
  scene.seen = [](const Vec3& p) { return p.x() < 0.02; };
  const Path path({{-0.04, 0, 0.01},
                   {-0.04, 0, -0.008},
                   {0.06, 0, -0.008},
                   {-0.04, 0, -0.008},
                   {-0.04, 0, 0.01}},
                  s.speed);
  Setting unjudged = s;
  unjudged.judged = false;  // the optimum knows no unknown space
  Run run = slide(16, "", unjudged, std::move(scene), path, {.j = 0.3});
  double lateral = 0;
  int held = 0;
  for (const Row& row : run.rows) {
    lateral = std::max(lateral, std::hypot(row.f.x(), row.f.y()));
    held += row.telemetry.held ? 1 : 0;
  }
  add(run, "lateral N", lateral, 0.2);
  add(run, "ticks without a held frame", held > 0 ? 0 : 1, 0);
  return {run};
}

}  // namespace stability
