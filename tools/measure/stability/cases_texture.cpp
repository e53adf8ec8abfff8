// The texture on a device that is a body: its height, what a loop costs, and that it stays quiet.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "tools/measure/stability/body.hpp"
#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/support/haptic_loops.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

constexpr double kAmplitude = 0.0003, kPeriod_m = 0.002;  // of the bumps

Scene textured(const Setting& s, bool shade, double stiffness, const Body& body) {
  Scene scene = held(s, solids::floor, body, stiffness);
  scene.config.shade = shade;
  scene.config.texture_amplitude_m = kAmplitude;
  scene.config.texture_period_m = kPeriod_m;
  return scene;
}

// The device rests on the texture under a push: how fast it still moves.
double texture_residual(const Setting& s, bool shade, double stiffness, double push_N) {
  const Body body{0.2, 2, 0, 0};
  Rig r(textured(s, shade, stiffness, body));
  Twin twin(body, {}, {0.0004, 0.0003, 0.001 + s.tip_radius_m});
  double residual = 0;
  for (int k = 0; k < 3000; ++k) {
    const Row row = r.tick(twin.reading());
    twin.advance(row.f, {0, 0, -push_N}, Vec3::Zero(), Vec3::Zero());
    if (k >= 2900) residual = std::max(residual, twin.velocity().norm());
  }
  return residual;
}

// Ten periods there and back at a depth, along x of the grid: the texture lies in the map. Where
// d + a is within the reach the height has to be felt as it is.
struct Felt {
  std::vector<Row> rows;
  double error = 0;       // of what is felt against d + a there, at most
  double half_range = 0;  // of all that is felt
  int within = 0;         // ticks
};
Felt felt_at(const Setting& s, Rig& r, double stiffness, double reach_m) {
  const double depth_m = 0.5 * reach_m;
  const Vec3 x_S = r.setup().X_WS.linear().transpose() * Vec3::UnitX();
  const Vec3 along = (x_S - x_S.z() * Vec3::UnitZ()).normalized();
  const double rest = s.tip_radius_m;
  const Vec3 at(0, 0, rest - depth_m);
  const Path down({Vec3(0, 0, rest + 0.003), at}, s.speed);
  r.run(down, 0, down.duration());
  r.run([&](double) { return Vec3(at); }, 0, 0.1);
  const Path there({at, at + 0.02 * along, at}, s.speed);
  Felt out;
  out.rows = r.run(there, 0, there.duration());
  double least = 1e9, most = -1e9;
  for (const Row& row : out.rows) {
    const Vec3 foot_W = s.place.X_WS * Vec3(row.h.x(), row.h.y(), rest);
    double height = 0;
    for (int a = 0; a < 3; ++a)
      height += kAmplitude * std::sin(2 * std::numbers::pi * foot_W[a] / kPeriod_m);
    const double felt = row.f.z() / stiffness;
    if (depth_m + height <= reach_m) {
      ++out.within;
      out.error = std::max(out.error, std::abs(felt - std::max(0.0, depth_m + height)));
    }
    least = std::min(least, felt);
    most = std::max(most, felt);
  }
  out.half_range = 0.5 * (most - least);
  return out;
}

// The reach that device and slew guard leave: a bump is a spring along the surface, K d C at depth
// d. Of what the device renders stably 3/4, of what the guard follows at 100 mm/s 4/5.
double due_reach_m(const Rig& r) {
  const tasks::HapticConfig& c = r.setup().config;
  constexpr double kSpeed = 0.1, kWave = 2 * std::numbers::pi / kPeriod_m;
  const double guard =
      std::min(c.slew_calm_N_per_s / kSpeed + 2 * std::max(c.stiffness_N_per_m, 1000.0),
               std::max(c.slew_N_per_s / kSpeed, 1.1 * c.stiffness_N_per_m));
  const double side = std::min(0.75 * r.setup().device.stiffness_limit(kPeriod), 0.8 * guard);
  return side / (c.stiffness_N_per_m * kAmplitude * kWave * kWave);
}

// Closed loops: every run has its own, eight runs of a setting 200 at each damping.
constexpr int kLoops = 25;

std::vector<Run> texture_runs(const Setting& s, bool shade) {
  std::vector<Run> out;
  for (const double stiffness : {300.0, 1000.0}) {
    const Body body{0.2, 20, 0, 0};
    Rig r(textured(s, shade, stiffness, body));
    const double reach = r.task().texture_reach_m();
    Felt felt = felt_at(s, r, stiffness, reach);
    Run run;
    run.id = 19;
    run.name = title(text("K %.1f N/mm%s", 1e-3 * stiffness, shade ? "" : ", no shading"), s);
    run.rows = std::move(felt.rows);
    run.figures = rig::figures(run.rows);
    add_gates(run);
    const double wave_hz = s.speed / kPeriod_m;
    if (wave_hz < 99) add(run, "amplitude error %", 100 * felt.error / kAmplitude, 10);
    const double share = static_cast<double>(felt.within) / static_cast<double>(run.rows.size());
    add(run, "ticks beyond the reach %", 100 * (1 - share), 70);
    add(run, "reach short of its due %", 100 * (1 - reach / due_reach_m(r)), 30);
    const std::uint64_t seed =
        (s.tip_radius_m > 0 ? 400 : 0) + (shade ? 0 : 200) + (stiffness > 500 ? 100 : 0);
    for (const double b : {2.0, 20.0}) {
      const loops::Worst worst =
          loops::worst_of(textured(s, shade, stiffness, {0.2, b, 0, 0}), seed, kLoops);
      add(run, text("loop energy at b %.0f mJ", b), 1e3 * worst.energy_J, 1e3 * loops::kLimit_J);
    }
    run.note =
        text("reach %.2f mm, amplitude at half of it %.3f mm", 1e3 * reach, 1e3 * felt.half_range);
    if (stiffness < 500) {
      add(run, "residual speed at 0.3 N/mm, mm/s", 1e3 * texture_residual(s, shade, stiffness, 1),
          3);
      run.note += text("; under 3 N %.1f mm/s", 1e3 * texture_residual(s, shade, stiffness, 3));
    } else {
      double quiet = 0;
      for (double k = 300; k < 3000 && texture_residual(s, shade, k, 1) < 0.003; k *= 1.25)
        quiet = k;
      run.note += text(", quiet up to %.2f N/mm", 1e-3 * quiet);
    }
    out.push_back(std::move(run));
  }
  return out;
}

// With and without shading.
std::vector<Run> both_ways(const Setting& s) {
  std::vector<Run> out = texture_runs(s, true);
  for (Run& run : texture_runs(s, false)) out.push_back(std::move(run));
  return out;
}

}  // namespace

std::vector<Run> case_texture(const Setting& s) { return with_both_tips(s, both_ways); }

}  // namespace stability
