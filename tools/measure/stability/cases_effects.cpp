// Cases with friction.
#include <algorithm>
#include <cmath>
#include <functional>

#include "rt/quantile.hpp"
#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

constexpr double kStatic = 0.3, kDynamic = 0.24;

Scene rough(const Setting& s, std::function<double(const Vec3&)> solid) {
  Scene scene = still_scene(s, std::move(solid));
  scene.config.friction_static = kStatic;
  scene.config.friction_dynamic = kDynamic;
  return scene;
}

// How much friction a tick takes off beyond what breaking loose does.
struct Drop {
  double most = 0;  // in a tick
  double beyond_slip = 0;
  void take(double less, double stretch_N) {
    most = std::max(most, less);
    beyond_slip = std::max(beyond_slip, less - (kStatic - kDynamic) * stretch_N);
  }
};

// The field optimum with the definition's friction about it.
struct Model {
  double f_error_p95 = 0, p_error_p95 = 0;
  double f_error_guarded = 0;  // of the model behind the slew guard against itself
  Drop at_wall, anywhere;
};
using Where = std::function<bool(const Vec3& h)>;

Model model_of(const Run& run, const rig::Rig& r, const std::vector<rig::Optimum>& path,
               std::size_t stride, const Where& at_wall) {
  const support::ReferenceField field = rig::reference_field(r, run.rows);
  const rig::Scene& scene = r.setup();
  const double k = scene.config.stiffness_N_per_m, radius = scene.config.tip_radius_m;
  FrictionModel friction(kStatic, kDynamic);
  std::vector<double> f_error, p_error, f_guarded_error;
  Model out;
  Vec3 f_guarded = Vec3::Zero(), h_last = run.rows.front().h;
  double before = 0, stretch = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Row& row = run.rows[path[i].row];
    const bool apart = i > 0 && path[i].row > path[i - 1].row + stride;
    if (apart) friction.leave();
    // Held back into a wall by friction: the free place nearest to there.
    const Vec3 p = scene.X_WS.inverse() *
                   nearest_free(field, scene.X_WS * friction.follow(path[i].p, row.h), radius);
    Vec3 f = k * (p - row.h);
    f *= std::min(1.0, 12 / std::max(f.norm(), 1e-9));
    f_error.push_back((row.f - f).norm());
    p_error.push_back(1e3 * (row.p - p).norm());
    if (apart) f_guarded = Vec3::Zero();
    const double most =
        std::max(0.3 * static_cast<double>(stride), 1.1 * k * (row.h - h_last).norm());
    const Vec3 change = f - f_guarded;
    f_guarded += change * std::min(1.0, most / std::max(change.norm(), 1e-12));
    f_guarded_error.push_back((f - f_guarded).norm());
    h_last = row.h;
    const double rubs = k * (p - path[i].p).norm();
    if (i > 0 && !apart) {
      out.anywhere.take(before - rubs, stretch);
      if (at_wall(row.h)) out.at_wall.take(before - rubs, stretch);
    }
    before = rubs;
    stretch = k * (path[i].p - row.h).norm();
  }
  out.f_error_p95 = rt::quantile(f_error, 0.95);
  out.p_error_p95 = rt::quantile(p_error, 0.95);
  out.f_error_guarded = rt::quantile(f_guarded_error, 0.95);
  return out;
}

struct Drops {
  double most = 0;  // friction, N
  Drop at_wall, anywhere;
};
// `smooth`: the same ticks without friction.
template <class AtWall>
Drops drops_of(const std::vector<Row>& rows, const std::vector<Row>& smooth,
               const AtWall& at_wall) {
  Drops out;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const Row &row = rows[i], &last = rows[i - 1];
    const double f = row.telemetry.friction_N, less = last.telemetry.friction_N - f;
    out.most = std::max(out.most, f);
    if (!row.telemetry.in_contact) continue;
    const double stretch = 1000 * (smooth[i - 1].p - last.h).norm();
    out.anywhere.take(less, stretch);
    if (at_wall(row.h)) out.at_wall.take(less, stretch);
  }
  return out;
}

std::vector<Run> friction_corner_runs(const Setting& s) {
  const double tip = s.tip_radius_m;
  std::vector<Vec3> points{{-0.05, 0, 0.005},
                           {-0.05, 0, -0.008},
                           {0.008, 0, -0.008},
                           {0.008, 0.03, -0.008},
                           {0.008, 0.03, 0.05}};
  for (Vec3& p : points) p += Vec3(-tip, 0, tip);
  const Path path(points, s.speed);
  rig::Rig r(rough(s, solids::concave_edge));
  Run run;
  run.id = 3;
  run.name = title("", s);
  std::vector<Row> smooth;
  const auto ticks = static_cast<int>(std::llround(1000 * path.duration()));
  for (int i = 0; i < ticks; ++i) {
    run.rows.push_back(r.tick(path(1e-3 * i)));
    Row row = run.rows.back();
    row.p = s.place.X_WS.inverse() * r.task().proxy().rendered_WP();
    row.f = r.setup().config.stiffness_N_per_m * (row.p - row.h);
    row.f *= std::min(1.0, 12 / std::max(row.f.norm(), 1e-9));
    smooth.push_back(row);
  }
  run.figures = rig::figures(run.rows);
  add_gates(run);
  const double moving = 1.2 * 1000 * s.speed * 1e-3 + 0.02;
  add(run, "J N", run.figures.j, std::max({0.25, moving, 0.33}));
  add(run, "guard use", run.figures.guard_share, 0.06);
  // Where the second wall is met: the floor bears the hand, the hand is about to reach the wall.
  const auto at_wall = [=](const Vec3& h) {
    return std::abs(h.x() + tip) < 0.004 && h.z() < tip - 0.0079 && h.y() < 1e-9;
  };
  const auto [most, drop, anywhere] = drops_of(run.rows, smooth, at_wall);
  add_pops(run, r, false);
  Model model;
  model.at_wall.most = model.anywhere.beyond_slip = model.f_error_guarded = std::nan("");
  if (s.judged) {
    const auto stride =
        static_cast<std::size_t>(std::max(1.0, std::round(0.1e-3 / (1e-3 * s.speed))));
    rig::Figures f;
    const std::vector<rig::Optimum> path_of = rig::score(r, smooth, f, stride);
    model = model_of(run, r, path_of, stride, at_wall);
    add(run, "frictionless F error p95 N", f.f_error_p95, 0.3, f.f_error_guarded_optimum,
        Yardstick::kGuarded);
    add(run, "frictionless p error p95 mm", 1e3 * f.p_error_p95, 0.5);
    add(run, "frictionless unused N", f.unused_max, 0.9, f.unused_optimum);
    add(run, "F error p95 N", model.f_error_p95, 0.3, model.f_error_guarded, Yardstick::kGuarded);
    add(run, "p error p95 mm", model.p_error_p95, 0.5);
  }
  add(run, "friction dropped N", drop.most, 0.1, model.at_wall.most);
  // Elsewhere by no more than breaking loose takes off, as in case 18.
  add(run, "friction dropped beyond slip N", anywhere.beyond_slip, std::max(0.1, moving),
      model.anywhere.beyond_slip);
  run.note =
      text("most friction %.2f N, largest drop at the wall %.3f N (model %.3f), anywhere %.3f",
           most, drop.most, model.at_wall.most, anywhere.most);
  return {run};
}

std::vector<Run> friction_hold_runs(const Setting& s) {
  rig::Rig r(rough(s, solids::floor));
  const double z = s.tip_radius_m - 0.008;
  // Input of an encoder: 10 um steps, and a hand that trembles by one of them.
  const auto quantum = [](const Vec3& p) {
    return Vec3(1e-5 * std::round(p.x() / 1e-5), 1e-5 * std::round(p.y() / 1e-5),
                1e-5 * std::round(p.z() / 1e-5));
  };
  const Path down({{0, 0, z + 0.018}, {0, 0, z}}, s.speed);
  r.run([&](double t) { return quantum(down(t)); }, 0, down.duration());
  // To 60 % of the cone: 0.6 x 0.3 x 8 mm = 1.44 mm.
  constexpr double kHold_N = 0.6 * kStatic * 8;
  const Path aside({{0, 0, z}, {1e-3 * kHold_N, 0, z}}, s.speed);
  r.run([&](double t) { return quantum(aside(t)); }, 0, aside.duration());
  Run run;
  run.id = 18;
  run.name = title("", s);
  run.rows =
      r.run([&](double t) { return quantum(Vec3(1e-3 * kHold_N + 6e-6 * std::sin(7 * t), 0, z)); },
            0, 10);
  double creep = 0, hold = 0;
  for (const Row& row : run.rows) {
    creep = std::max(creep, (row.p - run.rows[0].p).norm());
    hold = std::max(hold, std::abs(std::hypot(row.f.x(), row.f.y()) - kHold_N));
  }
  // Then a slide, and back.
  const Path slide_on({{1e-3 * kHold_N, 0, z}, {0.03, 0, z}, {0.01, 0, z}}, s.speed);
  const double turn = 0.02856 / s.speed;
  auto rows = r.run([&](double t) { return quantum(slide_on(t)); }, 0, slide_on.duration());
  double slip = 0, reversal = 0, sliding = 0, loose = 0;
  const double from = rows.front().t;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    // Before any guard while it slides on; what the hand gets while it turns and breaks loose
    // again.
    const double t = rows[i].t - from;
    if (t < turn - 0.002) {
      slip = std::max(slip, (rows[i].f_raw - rows[i - 1].f_raw).norm());
      loose = std::max(loose, std::hypot(rows[i].f_raw.x(), rows[i].f_raw.y()));
    } else {
      reversal = std::max(reversal, (rows[i].f - rows[i - 1].f).norm());
    }
    if (t < turn && rows[i].h.x() > 0.02) sliding = rows[i].telemetry.friction_N;
  }
  run.rows.insert(run.rows.end(), rows.begin(), rows.end());
  run.figures = rig::figures(run.rows);
  add_gates(run);
  const double moving = 1.2 * 1000 * s.speed * 1e-3 + 0.02;
  add(run, "creep mm", 1e3 * creep, 0.05);
  add(run, "hold friction error N", hold, 0.1);
  add(run, "breakaway friction error N", std::abs(loose - kStatic * 8), moving);
  add(run, "slip step N", slip, std::max(0.58, moving));
  add(run, "reversal step N", reversal, std::max(0.3, moving));
  add(run, "slide friction error N", std::abs(sliding - kDynamic * 8), 0.1);
  add_pops(run, r, false);
  return {run};
}

}  // namespace

std::vector<Run> case_friction_corner(const Setting& s) {
  return with_both_tips(s, friction_corner_runs);
}
std::vector<Run> case_friction_hold(const Setting& s) {
  return with_both_tips(s, friction_hold_runs);
}

}  // namespace stability
