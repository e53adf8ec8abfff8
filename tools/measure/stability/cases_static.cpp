// Cases on solids that stand still.
#include <algorithm>
#include <iterator>
#include <memory>

#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

// Every place of the way moved by the tip's radius: how a tip of 3 mm is as deep as a point.
std::vector<Vec3> moved(std::vector<Vec3> points, const Vec3& by) {
  for (Vec3& p : points) p += by;
  return points;
}

// The rows of the run while the hand is this deep, and what the optimum does in the same ticks,
// linear between its places.
struct Deep {
  std::vector<Vec3> ours, optimum;
};
Deep forces_below(const Run& run, double z) {
  Deep out;
  std::size_t k = 0;
  for (std::size_t i = 0; i < run.rows.size(); ++i) {
    if (run.rows[i].h.z() > z) continue;
    out.ours.push_back(run.rows[i].f);
    while (k + 1 < run.optimum.size() && run.optimum[k + 1].row < i) ++k;
    if (k + 1 >= run.optimum.size()) continue;
    const auto &a = run.optimum[k], &b = run.optimum[k + 1];
    const double t =
        (static_cast<double>(i) - static_cast<double>(a.row)) / static_cast<double>(b.row - a.row);
    out.optimum.emplace_back(a.f + std::clamp(t, 0.0, 1.0) * (b.f - a.f));
  }
  return out;
}

std::vector<Run> floor_runs(const Setting& s) {
  const double above = 0.002 + 3 * s.tip_radius_m,  // a start inside would fade in
      z = raised_m(s) - 0.008, radius = s.tip_radius_m;
  const Path path({{-0.05, 0, above}, {-0.05, 0, z}, {0.05, 0, z}, {0.05, 0, above}}, s.speed);
  Run run = slide(1, "", s, still_scene(s, solids::floor), path, {.j = 0.12, .side = true});
  const auto deep = [=](const Vec3& h) { return h.z() < z + 1e-5; };
  add(run, "tangential N",
      worst_of(run, s,
               [&](const Vec3& h, const Vec3&, const Vec3& f) {
                 return deep(h) ? std::hypot(f.x(), f.y()) : std::nan("");
               }),
      0.03);
  add(run, "depth error mm",
      worst_of(run, s,
               [&](const Vec3& h, const Vec3& p, const Vec3&) {
                 return deep(h) ? 1e3 * std::abs(p.z() - radius) : std::nan("");
               }),
      0.05);
  const Deep f = forces_below(run, z + 1e-5);
  add(run, "chatter N", chatter_N(f.ours), 0.02, s.judged ? chatter_N(f.optimum) : std::nan(""));
  return {run};
}

std::vector<Run> concave_runs(const Setting& s) {
  const double r = raised_m(s), radius = s.tip_radius_m;
  const Path path(moved({{-0.05, 0, 0.005},
                         {-0.05, 0, -0.008},
                         {0.008, 0, -0.008},
                         {0.008, 0.03, -0.008},
                         {0.008, 0.03, 0.05},
                         {-0.01, 0.03, 0.05}},
                        {-r, 0, r}),
                  s.speed);
  double off_zero = 0;
  Run run = slide(2, "", s, still_scene(s, solids::concave_edge, -Vec3::UnitX()), path,
                  {.crease = true}, [&](const rig::Rig& rig, const Run& done) {
                    if (s.fused == nullptr || radius == 0) {
                      off_zero = off_zero_set_m(rig, done.rows, 5);
                    }
                  });
  const Worst truth = worst_of(run, s, [&](const Vec3& h, const Vec3& p, const Vec3&) {
    return (p - h).norm() > 1e-6 ? 1e3 * std::abs(solids::concave_edge(p) - radius) : 0.0;
  });
  add(run, "off the zero set mm", 1e3 * off_zero, 1);
  add(run, "off the true shape mm", truth, 3);
  if (s.fused != nullptr) return {run};
  Vec3 corner = Vec3::Zero();
  for (const Row& row : run.rows) {
    if (std::abs(row.h.y() - 0.015) <= 0.6e-3 * s.speed) corner = row.f;
  }
  if (s.place.name == "0deg/0" && radius == 0) {  // the samples hold this shape exactly
    add(run, "corner F N", (corner - Vec3(-8, 0, 8)).norm(), 0.4);
  }
  run.note = text("off the true shape %.2f mm (optimum %.2f); corner F (%.2f, %.2f), true (-8, 8)",
                  truth.ours, truth.optimum, corner.x(), corner.z());
  return {run};
}

std::vector<Run> room_runs(const Setting& s) {
  const double r = raised_m(s), radius = s.tip_radius_m;
  constexpr double kDeep = 0.006;
  const Vec3 corner(kDeep - r, kDeep - r, r - kDeep);
  const Path path(moved({{-0.04, -0.04, 0.01},
                         {-0.04, -0.04, -kDeep},
                         {kDeep, kDeep, -kDeep},
                         {kDeep, kDeep, 0.03},
                         {-0.01, -0.01, 0.03},
                         {kDeep, kDeep, -kDeep},
                         {-0.02, -0.02, 0.01}},
                        {-r, -r, r}),
                  s.speed);
  Vec3 rest = Vec3::Zero();
  Run run = slide(5, "", s, still_scene(s, solids::room_corner, Vec3(-1, -1, 0).normalized()), path,
                  {.crease = true}, [&](rig::Rig& rig, const Run& done) {
                    const Path back({done.rows.back().h, corner}, s.speed);
                    rest = rig.run(back, 0, back.duration() + 0.2).back().f;
                  });
  if (s.fused != nullptr) return {run};
  const Vec3 right = 1e3 * kDeep * Vec3(-1, -1, 1);
  if (s.place.name == "0deg/0" && radius == 0) {  // the samples hold this shape exactly
    add(run, "corner F N", (rest - right).cwiseAbs().maxCoeff(), 0.05 * 1e3 * kDeep);
  }
  run.note = text("at rest in the corner F (%.2f, %.2f, %.2f), true (-6, -6, 6)", rest.x(),
                  rest.y(), rest.z());
  return {run};
}

std::vector<Run> edge_runs(const Setting& s) {
  const double r = raised_m(s), z = r - 0.008;
  const Path path({{-0.06, 0, 0.005 + r}, {-0.06, 0, z}, {0.03, 0, z}}, s.speed);
  Run run = slide(6, "", s, still_scene(s, solids::convex_edge), path, {.crease = true});
  add(run, "lateral before edge mm",
      worst_of(run, s,
               [=](const Vec3& h, const Vec3&, const Vec3& f) {
                 return h.z() < z + 1e-5 && std::hypot(f.x(), f.y()) > 0.3 ? -1e3 * h.x() : 0.0;
               }),
      2);
  if (run.figures.judged_share < 1 - kUnjudged)
    return {run};  // unknown space ends contacts as well
  int entries = 0;
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    const Row& row = run.rows[i];
    entries += row.telemetry.in_contact && !run.rows[i - 1].telemetry.in_contact ? 1 : 0;
  }
  add(run, "entries", entries, 1);
  return {run};
}

std::vector<Run> rim_runs(const Setting& s) {
  const double r = raised_m(s), rest = s.tip_radius_m;
  const Path path({{-0.012, 0, 0.01 + r}, {-0.012, 0, r - 0.03}, {-0.012, 0, 0.01 + r}}, s.speed);
  Run run = slide(7, "", s, still_scene(s, solids::convex_edge), path, {.crease = true});
  add(run, "turned deg",
      worst_of(run, s,
               [=](const Vec3& h, const Vec3&, const Vec3& f) {
                 return h.z() < rest - 0.001 && f.norm() > 0.05 ? angle_deg(f, Vec3::UnitZ()) : 0.0;
               }),
      5);
  add(run, "size error N",
      worst_of(run, s,
               [=](const Vec3& h, const Vec3&, const Vec3& f) {
                 return h.z() < rest - 0.001
                            ? std::abs(f.norm() - std::min(12.0, 1000 * (rest - h.z())))
                            : 0.0;
               }),
      0.3);
  return {run};
}

std::vector<Run> saddle_runs(const Setting& s) {
  // Fused: the middle of the sheet alone, which a camera at 70 degrees still sees all of.
  const double size = s.fused != nullptr ? 0.35 : 1.0, r = raised_m(s), radius = s.tip_radius_m;
  std::vector<Vec3> points{{size * -0.04, size * -0.02, 0.02 + r}};
  const auto at = [=](double x, double y) {
    return Vec3(size * x, size * y, 6 * size * size * (x * x - y * y) - 0.008 + r);
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
  Scene scene = still_scene(
      s,
      [rays = s.fused != nullptr](const Vec3& p) {
        return rays ? solids::saddle_bound(p, 6) : solids::saddle(p, 6);
      },
      Vec3::UnitY());
  if (scene.truth) scene.truth = [](const Vec3& p) { return solids::saddle(p, 6); };
  Run run = slide(10, "", s, std::move(scene), path, {.j = 0.1, .crease = true, .side = true});
  add(run, "off truth mm",
      worst_of(run, s,
               [=](const Vec3& h, const Vec3& p, const Vec3&) {
                 return (p - h).norm() > 1e-6 ? 1e3 * std::abs(solids::saddle(p, 6) - radius) : 0.0;
               }),
      0.3);
  if (run.figures.judged_share < 1 - kUnjudged) return {run};
  double curl = 0, curl_raw = 0, curl_optimum = 0, curl_guarded = 0;
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    const Row &row = run.rows[i], &last = run.rows[i - 1];
    if (row.t > before.duration() + 1e-9) {
      curl += 0.5 * (row.f + last.f).dot(row.h - last.h);
      curl_raw += 0.5 * (row.f_raw + last.f_raw).dot(row.h - last.h);
    }
  }
  for (std::size_t i = 1; i < run.optimum.size(); ++i) {
    const auto &o = run.optimum[i], &last = run.optimum[i - 1];
    if (run.rows[last.row].t > before.duration()) {
      const Vec3 way = run.rows[o.row].h - run.rows[last.row].h;
      curl_optimum += 0.5 * (o.f + last.f).dot(way);
      curl_guarded += 0.5 * (o.f_guarded + last.f_guarded).dot(way);
    }
  }
  // The optimum is no bound here: each ridge that its rest ends at costs energy, and a renderer may
  // go over it for nothing.
  add(run, "loop energy mJ", 1e3 * std::abs(curl), 0.2,
      s.judged ? 1e3 * std::abs(curl_guarded) : std::nan(""), Yardstick::kGuarded);
  run.checks.back().binds = false;
  run.note = text("loop %.2f mJ, before the guard %.2f; optimum %.2f, before the guard %.2f",
                  1e3 * curl, 1e3 * curl_raw, 1e3 * curl_guarded, 1e3 * curl_optimum);
  return {run};
}

std::vector<Run> deep_runs(const Setting& s) {
  const double r = raised_m(s);
  const Path path({{0, 0, 0.01 + r}, {0, 0, r - 0.06}, {0, 0, 0.01 + r}}, s.speed);
  Run run = slide(15, "", s, still_scene(s, solids::floor), path, {.j = 0.12, .side = true});
  double turned = 0, missing = 0;
  for (const Row& row : run.rows) {
    if (row.h.z() > r - 0.0125) continue;
    missing = std::max(missing, 12 - row.f.z());
    turned = std::max(turned, angle_deg(row.f, Vec3::UnitZ()));
  }
  add(run, "missing force N", missing, 0.01);
  add(run, "turned deg", turned, 1);
  add(run, "still in contact", run.rows.back().telemetry.in_contact ? 1 : 0, 0);
  return {run};
}

// Seen up to 20 mm beyond the middle.
Scene half_seen(const Setting& s) {
  Scene scene = still_scene(s, solids::floor);
  scene.seen = [](const Vec3& p) { return p.x() < 0.02; };
  return scene;
}

std::vector<Run> border_runs(const Setting& s) {
  const double r = raised_m(s), z = r - 0.008;
  const Path path(
      {{-0.04, 0, 0.01 + r}, {-0.04, 0, z}, {0.06, 0, z}, {-0.04, 0, z}, {-0.04, 0, 0.01 + r}},
      s.speed);
  Setting unjudged = s;
  unjudged.judged = false;  // the optimum knows no unknown space
  Run run = slide(16, "", unjudged, half_seen(s), path, {.j = 0.3, .side = true});
  double lateral = 0;
  int held = 0;
  for (const Row& row : run.rows) {
    lateral = std::max(lateral, std::hypot(row.f.x(), row.f.y()));
    held += row.telemetry.held ? 1 : 0;
  }
  add(run, "lateral N", lateral, 0.2);
  add(run, "ticks without a held frame", held > 0 ? 0 : 1, 0);
  // From behind, out of what was never seen: nothing until the hand has been in seen-free space,
  // then a contact as any.
  rig::Rig rig(half_seen(s));
  const Path behind({{0.06, 0, z}, {-0.04, 0, z}, {-0.04, 0, 0.01 + r}}, s.speed);
  double unseen = 0;
  for (const Row& row : rig.run(behind, 0, behind.duration())) {
    unseen = std::max(unseen, row.f.norm());
  }
  const Path again({{-0.04, 0, 0.01 + r}, {-0.04, 0, z}}, s.speed);
  const double felt = rig.run(again, 0, again.duration() + 0.05).back().f.z();
  add(run, "force out of the unknown N", unseen, 0);
  add(run, "force after it N", std::abs(felt - 8), 0.05);
  return {run};
}

}  // namespace

std::vector<Run> case_floor(const Setting& s) { return with_both_tips(s, floor_runs); }
std::vector<Run> case_concave_corner(const Setting& s) { return with_both_tips(s, concave_runs); }
std::vector<Run> case_room_corner(const Setting& s) { return with_both_tips(s, room_runs); }
std::vector<Run> case_convex_edge(const Setting& s) { return with_both_tips(s, edge_runs); }
std::vector<Run> case_rim_press(const Setting& s) { return with_both_tips(s, rim_runs); }
std::vector<Run> case_saddle(const Setting& s) { return with_both_tips(s, saddle_runs); }
std::vector<Run> case_deep_press(const Setting& s) { return with_both_tips(s, deep_runs); }
std::vector<Run> case_border(const Setting& s) { return with_both_tips(s, border_runs); }

}  // namespace stability
