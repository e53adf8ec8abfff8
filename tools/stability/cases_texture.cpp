// The texture on a device that is a body: its height, what a loop costs, and that it stays quiet.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "tests/support/haptic_solids.hpp"
#include "tools/stability/body.hpp"
#include "tools/stability/case_text.hpp"
#include "tools/stability/cases.hpp"

namespace stability {

namespace {

Scene textured(const Setting& s, bool shade, double stiffness, const Body& body) {
  Scene scene = held(s, solids::floor, body, stiffness);
  scene.config.shade = shade;
  scene.config.texture_amplitude_m = 0.0003;
  scene.config.texture_period_m = 0.002;
  return scene;
}

constexpr double kTextureDepth = 0.001;

// The device rests on the texture under a push: how fast it still moves. Aside, a bump holds it with a stiffness of
// at most K (effects.hpp).
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

std::vector<Run> texture_runs(const Setting& s, bool shade) {
  std::vector<Run> out;
  for (const double stiffness : {300.0, 1000.0}) {
    const Body body{0.2, 20, 0, 0};
    Rig r(textured(s, shade, stiffness, body));
    // Ten periods there and back, along x of the grid: the texture lies in the map.
    const Vec3 x_S = r.setup().X_WS.linear().transpose() * Vec3::UnitX();
    const Vec3 along = (x_S - x_S.z() * Vec3::UnitZ()).normalized();
    const double rest = s.tip_radius_m;
    const Vec3 depth(0, 0, rest - kTextureDepth);
    const Path down({Vec3(0, 0, rest + 0.003), depth}, s.speed);
    r.run(down, 0, down.duration());
    const Path there({depth, depth + 0.02 * along, depth}, s.speed);
    Run run;
    run.id = 19;
    run.name = title(text("K %.1f N/mm%s", 1e-3 * stiffness, shade ? "" : ", no shading"), s);
    run.rows = r.run(there, 0, there.duration());
    run.figures = rig::figures(run.rows);
    add_gates(run);
    double least = 1e9, most = -1e9, energy = 0;
    for (std::size_t i = 1; i < run.rows.size(); ++i) {
      const Row &row = run.rows[i], &last = run.rows[i - 1];
      least = std::min(least, row.f.z());
      most = std::max(most, row.f.z());
      energy += 0.5 * (row.f + last.f).dot(row.h - last.h);
    }
    // Ten times down on one flank, along, up on the other and back, deeper than the bumps' radius of curvature: not
    // conservative there, so it is printed.
    const Vec3 aside = 0.001 * along, deeper(0, 0, -0.001);
    std::vector<Vec3> round{depth};
    for (int i = 0; i < 10; ++i) {
      round.insert(round.end(), {depth + deeper, depth + deeper + aside, depth + aside, depth});
    }
    const Path loop(round, 0.01);
    Row last = run.rows.back();
    double loop_energy = 0;
    for (const Row& row : r.run(loop, 0, loop.duration())) {
      loop_energy += 0.5 * (row.f + last.f).dot(row.h - last.h);
      last = row;
    }
    // What the same way has to feel of the height over the foot of the hand, whatever the grid.
    double low = 1e9, high = -1e9;
    for (const Row& row : run.rows) {
      const Vec3 foot_W = s.place.X_WS * Vec3(row.h.x(), row.h.y(), rest);
      double height = 0;
      for (int a = 0; a < 3; ++a)
        height += 0.0003 * std::sin(2 * std::numbers::pi * foot_W[a] / 0.002);
      low = std::min(low, height);
      high = std::max(high, height);
    }
    const double amplitude = 0.5 * (most - least) / stiffness, right = 0.5 * (high - low);
    const double wave_hz = s.speed / 0.002;
    if (wave_hz < 99) add(run, "amplitude error %", 100 * std::abs(amplitude / right - 1), 10);
    add(run, "loop energy mJ", 1e3 * std::abs(energy), 0.2);
    if (stiffness < 500) {
      add(run, "residual speed at 0.3 N/mm, mm/s", 1e3 * texture_residual(s, shade, stiffness, 1),
          3);
      run.note = text("under 3 N %.1f mm/s; 10 loops over 1 mm of depth %.2f mJ",
                      1e3 * texture_residual(s, shade, stiffness, 3), 1e3 * loop_energy);
    } else {
      double quiet = 0;
      for (double k = 300; k < 3000 && texture_residual(s, shade, k, 1) < 0.003; k *= 1.25)
        quiet = k;
      run.note =
          text("amplitude %.3f mm, loop %.3f mJ, 10 over 1 mm of depth %.2f, quiet up to %.2f N/mm",
               1e3 * amplitude, 1e3 * energy, 1e3 * loop_energy, 1e-3 * quiet);
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
