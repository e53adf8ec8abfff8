// What the cases share: how a run is set up, titled and judged.
#include <algorithm>
#include <iterator>
#include <memory>

#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

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
  if (!s.layer) out += ", layer off";
  if (s.fused != nullptr) {
    out += text(", fused at %.0f deg%s, R %.0f mm", s.fused->incidence_deg,
                s.fused->noise ? " with noise" : "", 1e3 * s.tip_radius_m);
  } else if (s.tip_radius_m > 0) {
    out += text(", R %.0f mm", 1e3 * s.tip_radius_m);
  }
  return out;
}

bool on_fused_fields(int id) {
  constexpr int kIds[] = {1, 2, 5, 6, 7, 10, 13};
  return std::ranges::find(kIds, id) != std::end(kIds);
}

bool takes_tip(int id) { return id <= 19; }

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

void add(Run& run, std::string name, double value, double limit, double optimum, Yardstick by) {
  run.checks.push_back({std::move(name), value, limit, optimum, by});
}

void add_gates(Run& run) {
  double force = 0;
  for (const Row& row : run.rows) {
    force = std::max(force, row.f.allFinite() && row.p.allFinite() ? row.f.norm() : 1e9);
  }
  add(run, "force N", force, 12);
  run.checks.back().gate = true;
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
  scene.layer = s.layer;
  scene.config.passivity_controller = s.controller;
  if (s.method == "force_shading") scene.cast = ray_cast_of(s.place.X_WS, solid, lean);
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
    scene.truth = solid;
  }
  scene.config.tip_radius_m = s.tip_radius_m;
  scene.solid = [solid = std::move(solid)](const Vec3& p, double) { return solid(p); };
  scene.X_WS = s.place.X_WS;
  scene.still = true;
  scene.config.method = s.method;
  return scene;
}

Run slide(int id, const std::string& name, const Setting& s, Scene scene, const Path& path,
          const Limits& limits, const After& after) {
  Run run;
  run.id = id;
  run.name = title(name, s);
  const double k = scene.config.stiffness_N_per_m;
  rig::Rig r(std::move(scene));
  run.rows = r.run(path, 0, path.duration());
  run.figures = rig::figures(run.rows);
  const rig::Figures& f = run.figures;
  const double moving = 1.2 * k * s.speed * 1e-3 + 0.02,
               j_limit = std::max({limits.j, moving, limits.crease ? 0.33 : 0.0});
  if (s.judged) {
    // The oracle every 0.1 mm of the hand's way.
    const auto stride =
        static_cast<std::size_t>(std::max(1.0, std::round(0.1e-3 / (1e-3 * s.speed))));
    run.optimum = rig::score(r, run.rows, run.figures, stride, j_limit);
  }
  add_gates(run);
  add(run, "J N", f.j, j_limit,
      s.judged ? f.j_guarded_optimum : std::numeric_limits<double>::quiet_NaN(),
      Yardstick::kGuarded);
  add(run, "guard use", f.guard_share, 0.06);
  if (s.judged) {
    add(run, "below mm", 1e3 * f.below_max, 0.5);
    if (s.fused == nullptr) {
      add(run, "release lag ticks", release_lag(r, run.rows), 1);
    } else {  // the rest is in or after unknown space: nothing is said of it, so nothing is passed
      add(run, "not judged %", 100 * (1 - f.judged_share), 100 * kUnjudged);
    }
    if (limits.optimum) {
      add(run, "F error p95 N", f.f_error_p95, 0.3, f.f_error_guarded_optimum, Yardstick::kGuarded);
      add(run, "p error p95 mm", 1e3 * f.p_error_p95, 0.5);
      // An optimum with force unused is none, so it is no excuse.
      add(run, "unused N", f.unused_max, 0.9,
          f.unused_optimum <= 0.9 ? f.unused_optimum : std::nan(""));
    }
  }
  add_pops(run, r, limits.side);
  if (s.fused != nullptr && s.judged) {
    run.note = text("to the samples' own optimum: F error p95 %.3f N, p error p95 %.3f mm",
                    f.f_error_samples_p95, 1e3 * f.p_error_samples_p95);
  }
  if (after) after(r, run);
  return run;
}

std::vector<Run> with_both_tips(const Setting& s, std::vector<Run> (*runs)(const Setting&)) {
  std::vector<Run> out = runs(s);
  if (s.fused != nullptr || s.tip_radius_m > 0) return out;
  Setting round = s;
  round.tip_radius_m = 0.003;
  for (Run& run : runs(round)) out.push_back(std::move(run));
  return out;
}

double raised_m(const Setting& s) { return s.fused != nullptr ? 0 : s.tip_radius_m; }

}  // namespace stability
