// Cases where the surface, what is known of it, or the hand's side changes under the hand.
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "rt/random.hpp"
#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

// Height over (0, 0) at which a tip rests on the field that `frame` publishes.
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
    return sum - s.config.tip_radius_m;
  };
  double lo = -0.02, hi = 0.02;
  for (int k = 0; k < 40; ++k) {
    const double m = 0.5 * (lo + hi);
    (value(s.X_WS * Vec3(0, 0, m)) > 0 ? hi : lo) = m;
  }
  return 0.5 * (lo + hi);
}

Scene noisy_floor(const Setting& setting, double sigma) {
  Scene s = still_scene(setting, solids::floor);
  s.extra = [sigma](int x, int y, int z, int frame) {
    const auto key = (static_cast<std::uint64_t>(x + 4096) << 40U) |
                     (static_cast<std::uint64_t>(y + 4096) << 20U) |
                     static_cast<std::uint64_t>(z + 4096);
    return sigma * rt::Random(rt::mix64(77, key), static_cast<std::uint64_t>(frame)).normal();
  };
  return s;
}

// By how many ticks F follows the height of the newest published frame: the shift of the largest
// correlation.
int lag_ticks(const std::vector<Row>& rows, const std::vector<double>& height) {
  double mean_f = 0, mean_z = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    mean_f += rows[i].f.norm() / static_cast<double>(rows.size());
    mean_z += height[i] / static_cast<double>(rows.size());
  }
  int best = 0;
  double most = -1;
  for (int lag = 0; lag < 100; ++lag) {
    double sum = 0;
    for (std::size_t i = 100; i < rows.size(); ++i) {
      sum += (rows[i].f.norm() - mean_f) * (height[i - static_cast<std::size_t>(lag)] - mean_z);
    }
    if (sum > most) {
      most = sum;
      best = lag;
    }
  }
  return best;
}

Run finish(int id, const std::string& name, const Setting& s, std::vector<Row> rows) {
  Run run;
  run.id = id;
  run.name = title(name, s);
  run.rows = std::move(rows);
  run.figures = rig::figures(run.rows);
  add_gates(run);
  return run;
}

// `depth` below where the tip rests.
Path down_to(const Setting& s, double depth) {
  return Path({{0, 0, 0.02}, {0, 0, s.tip_radius_m - depth}}, s.speed);
}
void press(Rig& r, const Path& down, double until) {
  r.run(down, 0, std::max(until, down.duration()));
}

std::vector<Run> noise_runs(const Setting& s) {
  std::vector<Run> out;
  for (const double sigma : {0.001, 0.003}) {
    Rig r(noisy_floor(s, sigma));
    press(r, down_to(s, 0.008), 0.5);
    const int from = static_cast<int>(std::floor(rt::seconds(r.now() - rt::Time{}) * 30 + 1e-9));
    Run run = finish(11, text("%.0f mm", 1e3 * sigma), s,
                     r.run([&](double) { return Vec3(0, 0, s.tip_radius_m - 0.008); }, 0, 2.0));
    std::vector<double> f, height, of_tick;
    for (int frame = from; frame < from + 62; ++frame) height.push_back(surface_height(r, frame));
    int lost = 0;
    for (const Row& row : run.rows) {
      f.push_back(row.f.norm());
      lost += row.telemetry.in_contact ? 0 : 1;
      of_tick.push_back(
          height[static_cast<std::size_t>(static_cast<int>(std::floor(row.t * 30 + 1e-9)) - from)]);
    }
    const double sigma_z = deviation(height);
    const int lag = lag_ticks(run.rows, of_tick);
    add(run, "std F N", deviation(f), 1.2 * 1000 * sigma_z);
    add(run, "J N", run.figures.j, sigma < 0.002 ? 0.1 : 0.3);
    add(run, "lag ms", lag, 50);
    add(run, "ticks without contact", lost, 0);
    add_pops(run, r, true);
    run.note = text("std F %.3f N, sigma_z %.3f mm, J_raw %.2f N, lag %d ms", deviation(f),
                    1e3 * sigma_z, run.figures.j_raw, lag);
    out.push_back(std::move(run));
  }
  return out;
}

Run step_run(const Setting& s, double depth, double step) {
  Scene scene = still_scene(s, solids::floor);
  scene.still = false;
  const Path down = down_to(s, depth);
  const double at = std::max(0.5, down.duration() + 0.1), k = scene.config.stiffness_N_per_m;
  scene.solid = [=](const Vec3& p, double t) { return solids::floor(p) - (t > at ? step : 0); };
  Rig r(std::move(scene));
  press(r, down, 0.3);
  Run run = finish(12, text("%+.0f at %.0f mm", 1e3 * step, 1e3 * depth), s,
                   r.run([&](double) { return Vec3(0, 0, s.tip_radius_m - depth); }, 0,
                         at + 0.3 - down.duration()));
  const double goal = std::min(12.0, k * std::max(0.0, depth + step));
  const double published = std::ceil(at * 30 + 1e-6) / 30;
  double reached = 1;
  for (const Row& row : run.rows) {
    if (row.t >= at && reached == 1 && std::abs(row.f.norm() - goal) < 0.05) {
      reached = row.t - published;
    }
  }
  add(run, "J N", run.figures.j, 0.3);
  add(run, "time to the new level ms", 1e3 * reached, 50);
  add(run, "end force error N", std::abs(run.rows.back().f.norm() - goal), 0.05);
  add(run, "ticks inside in a row", longest_inside(run.rows, s.tip_radius_m), 2);
  add_pops(run, r, true);
  add_injected(run, k);
  const Injected in = injected(run.rows, k);
  run.note = text("%.1f mJ put in, at most %.1f by one window, %.1f before it was slowed",
                  1e3 * in.sum_J, 1e3 * in.whole_event_J, 1e3 * in.event_J);
  return run;
}

std::vector<Run> step_runs(const Setting& s) {
  std::vector<Run> out;
  for (const double depth : {0.002, 0.008}) {
    for (const double step : {0.005, -0.005}) out.push_back(step_run(s, depth, step));
  }
  return out;
}

// An exact proxy on windows of the true floor, which rises by 0.1 m/s from `at` on for `rise_s`:
// the last window fades into the newest over one period. NaN: there were none.
struct OnWindows {
  double lag_s = std::nan(""), height_m = lag_s;
};
OnWindows exact_on_windows(const std::vector<std::pair<double, double>>& windows, double at,
                           double rise_s) {
  OnWindows out;
  for (std::size_t i = 1; i < windows.size(); ++i) {
    const auto& [since, height] = windows[i];
    for (double t = since; t < since + 1.0 / 30; t += 1e-3) {
      if (t <= at + 0.05 || t >= at + rise_s) continue;
      const double blend = std::min((t - since) * 30, 1.0);
      const double shown = (1 - blend) * windows[i - 1].second + blend * height;
      if (!(t - at - shown / 0.1 <= out.lag_s)) out.lag_s = t - at - shown / 0.1;
    }
    out.height_m = height;
  }
  return out;
}

std::vector<Run> rise_runs(const Setting& s) {
  Setting sampled = s;
  sampled.fused = nullptr;
  Scene scene = still_scene(sampled, solids::floor);
  scene.still = false;
  // 2 mm deep, then 9 mm more: below the force limit, and no longer than that.
  constexpr double kDepth_m = 0.002, kRise_s = 0.09, kRise_m = 0.1 * kRise_s;
  const double radius = s.tip_radius_m, hand = radius - kDepth_m;
  const Path down({{0, 0, 0.02}, {0, 0, hand}}, s.speed);
  const double at = std::max(0.3, down.duration()) + 0.2;
  scene.solid = [=](const Vec3& p, double t) {
    return solids::floor(p) - 0.1 * std::clamp(t - at, 0.0, kRise_s);
  };
  const double k = scene.config.stiffness_N_per_m;
  // In each window: t, the true height; and how far off it the fused floor is in the last.
  const auto fused = std::make_shared<std::vector<std::pair<double, double>>>();
  const auto end_mm = std::make_shared<double>(0);
  if (s.fused != nullptr) {  // every image of the rising floor is fused
    const auto field = std::make_shared<FusedField>(s.place.X_WS, *s.fused);
    const auto now = [solid = scene.solid, field](double t) {
      field->see([&](const Vec3& p) { return solid(p, t); });
    };
    for (int i = 0; i < s.fused->frames; ++i) now(0);
    scene.window = [=](const Vec3& centre, int nodes, double t, perception::SurfacePatch& out) {
      now(t);
      field->window(centre, nodes, out);
      fused->emplace_back(t, 0.1 * std::clamp(t - at, 0.0, kRise_s));
      *end_mm = 1e3 * (field->height() - fused->back().second);
    };
  }
  Rig r(std::move(scene));
  r.run(down, 0, std::max(0.3, down.duration()));
  Run run = finish(13, "", s, r.run([=](double) { return Vec3(0, 0, hand); }, 0, 0.7));
  double lag = 0;
  int lost = 0;
  for (const Row& row : run.rows) {
    lost += row.telemetry.in_contact ? 0 : 1;
    const double height = row.p.z() - radius;
    if (row.t > at + 0.05 && row.t < at + kRise_s) lag = std::max(lag, row.t - at - height / 0.1);
  }
  const auto [fused_lag, fused_height] = exact_on_windows(*fused, at, kRise_s);
  const double fused_end = k * std::abs(kRise_m - fused_height);
  add(run, "J N", run.figures.j, 0.15);
  add(run, "lag ms", 1e3 * lag, 40, 1e3 * fused_lag);
  add(run, "ticks without contact", lost, 0);
  add(run, "end force error N", std::abs(run.rows.back().f.norm() - k * (kDepth_m + kRise_m)), 0.05,
      fused_end);
  add_pops(run, r, true);
  add_injected(run, k);
  if (s.fused != nullptr)
    run.note = text("fused floor at the end %+.3f mm off the true one", *end_mm);
  return {run};
}

std::vector<Run> vanish_runs(const Setting& s) {
  Scene scene = still_scene(s, solids::floor);
  scene.still = false;
  const Path down = down_to(s, 0.008);
  const double at = down.duration() + 0.2, k = scene.config.stiffness_N_per_m;
  scene.solid = [=](const Vec3& p, double t) { return t > at ? 1.0 : solids::floor(p); };
  Rig r(std::move(scene));
  press(r, down, 0);
  Run run =
      finish(14, "", s, r.run([&](double) { return Vec3(0, 0, s.tip_radius_m - 0.008); }, 0, 0.5));
  double first = 0, last = 0, previous = 8, rise = 0;
  for (const Row& row : run.rows) {
    const double f = row.f.norm();
    rise = std::max(rise, f - previous);
    previous = f;
    if (f > 7.95) first = row.t;
    if (f > 1e-9) last = row.t;
  }
  add(run, "J N", run.figures.j, 0.5);
  add(run, "rise N", rise, 2e-3);  // one unit of the patch is 1.5 um
  add(run, "slowest ms", 1e3 * (last - first), 60);
  add(run, "20 ms less it", 20 - 1e3 * (last - first), 0);
  add(run, "left over N", run.rows.back().f.norm(), 0);
  add_pops(run, r, true);
  add_injected(run, k);
  return {run};
}

// Forces that come back at a hand that is inside, `full_N` of them.
Run comes_back(const std::string& name, const Setting& s, Rig& r, std::vector<Row> rows,
               double full_N) {
  Run run = finish(17, name, s, std::move(rows));
  add_fade_in(run, full_N);
  add_pops(run, r, true);
  add_injected(run, r.setup().config.stiffness_N_per_m);
  return run;
}

double largest_N(const std::vector<Row>& rows) {
  double most = 0;
  for (const Row& row : rows) most = std::max(most, row.f.norm());
  return most;
}

constexpr double kPlate_m = 0.02;
Rig on_plate(const Setting& s) {
  return Rig(still_scene(s, [](const Vec3& p) { return solids::plate(p, kPlate_m); }));
}

Run started(const Setting& s) {
  Rig r(still_scene(s, solids::floor));
  auto rows = r.run([&](double) { return Vec3(0, 0, s.tip_radius_m - 0.008); }, 0, 0.3);
  return comes_back("start", s, r, std::move(rows), 8);
}

// Forces off at a hand `before` deep, on again when it is `after` deep: across the middle of the
// plate, where the nearest face is the wrong one.
Run enabled_again(const Setting& s, const std::string& name, double before, double after) {
  Rig r = on_plate(s);
  const double top = 0.5 * kPlate_m + s.tip_radius_m;
  const Vec3 outside(0, 0, top + 0.01), was(0, 0, top - before), is(0, 0, top - after);
  const Path down({outside, was}, s.speed), on({was, is}, s.speed);
  r.run(down, 0, down.duration() + 0.1);
  r.in().stylus.state = drivers::DeviceState::kBrake;
  const double off_N = largest_N(r.run(on, 0, on.duration() + 0.05));
  r.in().stylus.state = drivers::DeviceState::kForce;
  auto rows = r.run([&](double) { return Vec3(is); }, 0, 0.3);
  Run run = comes_back(name, s, r, std::move(rows), std::min(12.0, 1000 * after));
  add(run, "force while off N", off_N, 0);
  return run;
}

// The clutch held while the hand is inside: forces fade out, the device goes elsewhere, the hand in
// the scene stays.
Run clutched_again(const Setting& s) {
  Rig r = on_plate(s);
  const double top = 0.5 * kPlate_m + s.tip_radius_m;
  const Vec3 is(0, 0, top - 0.008), elsewhere(0.03, 0.01, top + 0.02);
  const Path down({{0, 0, top + 0.01}, is}, s.speed), away({is, elsewhere}, s.speed);
  const Row last = r.run(down, 0, down.duration() + 0.1).back();
  const Vec3 scene_before = r.task().to_world(s.place.X_WS * is);
  r.in().clutch = true;
  std::vector<Row> off = r.run([&](double) { return Vec3(is); }, 0, 0.15);
  off.insert(off.begin(), last);  // the first step is the one from before the clutch
  const double left_N = off.back().f.norm(),
               moving_N = largest_N(r.run(away, 0, away.duration() + 0.01));
  r.in().clutch = false;
  auto rows = r.run([&](double) { return Vec3(elsewhere); }, 0, 0.3);
  // The spring's stretch is in the scene, the device is elsewhere: told in the scene.
  for (Row& row : rows) row.h = is;
  Run run = comes_back("re-clutch", s, r, std::move(rows), 8);
  add(run, "J while the clutch is pressed N", rig::figures(off).j, 0.3);
  add(run, "force while clutched N", std::max(left_N, moving_N), 0);
  add(run, "hand in the scene moved mm",
      1e3 * (r.task().to_world(s.place.X_WS * elsewhere) - scene_before).norm(), 1e-6);
  return run;
}

std::vector<Run> start_inside_runs(const Setting& s) {
  std::vector<Run> out;
  out.push_back(started(s));
  out.push_back(enabled_again(s, "re-enable", 0.008, 0.008));
  out.push_back(enabled_again(s, "entered while off", -0.005, 0.008));
  out.push_back(enabled_again(s, "pushed through the middle while off", 0.008, 0.012));
  out.push_back(clutched_again(s));
  return out;
}

}  // namespace

std::vector<Run> case_noise(const Setting& s) { return with_both_tips(s, noise_runs); }
std::vector<Run> case_step(const Setting& s) { return with_both_tips(s, step_runs); }
std::vector<Run> case_rise(const Setting& s) { return with_both_tips(s, rise_runs); }
std::vector<Run> case_vanish(const Setting& s) { return with_both_tips(s, vanish_runs); }
std::vector<Run> case_start_inside(const Setting& s) {
  return with_both_tips(s, start_inside_runs);
}

}  // namespace stability
