// Materials and bumps: what changes under the hand, and what a loop over bumps gives back.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "rt/memory/non_realtime.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/measure/haptic/boundary.hpp"
#include "tools/measure/haptic/boundary_floor.hpp"

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

// What changes under the hand. Border and friction: the hand slides. Flicker and texture: the label
// flips with every window; under the texture the hand stands, since sliding over bumps turns the
// force by itself.
enum class Change { kBorder, kFlicker, kFriction, kAmplitude, kPeriod };

perception::Material material_of(Change change, int slot) {
  perception::Material m;
  switch (change) {
    case Change::kBorder:
    case Change::kFlicker:
      if (slot == 1) m.stiffness_scale = 0.4F;
      break;
    case Change::kFriction:
      m.friction_static = slot == 0 ? 0.3F : 0.1F;
      m.friction_dynamic = 0.8F * m.friction_static;
      break;
    case Change::kAmplitude:
      m.texture_amplitude_m = slot == 0 ? 3e-4F : 0;
      m.texture_period_m = 2e-3F;
      break;
    case Change::kPeriod:
      m.texture_amplitude_m = 3e-4F;
      m.texture_period_m = slot == 0 ? 2e-3F : 3.1e-3F;
      break;
  }
  return m;
}

// Down to 8 mm at 50 mm/s; then 100 mm/s along x over the border and back; with friction at 20 mm/s
// one way, so that it slips all the time; on the texture from place to place, 0.5 s at each.
Vec3 material_hand(Change change, double t) {
  // Bumps are asked where their height is felt (tasks/haptic/effects.hpp).
  const double deepest = change == Change::kAmplitude || change == Change::kPeriod ? 0.0005 : 0.008;
  const double z = std::max(0.005 - 0.05 * t, -deepest);
  if (t < 0.26) return Vec3(-0.04, 0.001, z);
  const double since = t - 0.26;
  double x = 0;
  if (change == Change::kFriction) {
    x = std::min(0.08, 0.02 * since);
  } else if (change == Change::kAmplitude || change == Change::kPeriod) {
    const double place = std::floor(since / 0.6);
    x = 0.0037 * (place + std::min(1.0, (since - 0.6 * place) / 0.1));
  } else {
    const double s = std::fmod(since, 1.6);
    x = 0.1 * (s < 0.8 ? s : 1.6 - s);
  }
  return Vec3(-0.04 + x, 0.001, z);
}

void measure_change(Change change, double rate_hz, double& worst_N, double& energy_min_J) {
  rt::Startup startup;
  tasks::HapticConfig config;
  config.materials = true;
  config.passivity_controller = true;
  drivers::DeviceProperties device;
  device.damping_N_s_per_m = 1e12;
  tasks::HapticTask task(startup.token(), config, device, 1 / rate_hz);
  std::array<std::unique_ptr<SurfacePatch>, 8> windows;
  for (auto& w : windows) {
    w = std::make_unique<SurfacePatch>();
    for (int slot = 0; slot < 2; ++slot) {
      w->palette[static_cast<std::size_t>(slot)] = material_of(change, slot);
    }
  }
  const bool still = change == Change::kAmplitude || change == Change::kPeriod;
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus_ok = true;
  in.stylus.state = drivers::DeviceState::kForce;
  std::uint64_t published = 0;
  Vec3 before = material_hand(change, 0);
  const auto ticks = static_cast<std::int64_t>((change == Change::kFriction ? 4 : 6) * rate_hz);
  for (std::int64_t k = 0; k < ticks; ++k) {
    const double t = static_cast<double>(k) / rate_hz;
    const rt::Time now = rt::time_from_ns(0) + rt::nanos_from_seconds(t);
    SurfacePatch* window = windows[published % windows.size()].get();
    if (std::floor(t * 30 + 1e-9) >= static_cast<double>(published)) {
      window = windows[++published % windows.size()].get();
      const int flip = static_cast<int>(published % 2);
      fill_floor(*window, 16,
                 [&](int x) { return change == Change::kBorder ? (x >= 0 ? 1 : 0) : flip; });
      window->seq = published;
      window->fused = now;
    }
    in.patch_newest = task.wants_patch() ? window : nullptr;
    in.stylus.p_DH = material_hand(change, t);
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(k);
    tick.release = tick.start = now;
    tick.period = rt::Nanos{std::llround(1e9 / rate_hz)};
    (void)task.step(tick, in, out);
    const double moved = config.stiffness_N_per_m * (in.stylus.p_DH - before).norm();
    before = in.stylus.p_DH;
    energy_min_J = std::min(energy_min_J, out.telemetry.energy_J + out.telemetry.booked_J);
    if (!out.telemetry.in_contact || k == 0 || (still && (moved > 0 || t < 0.3))) continue;
    if (change == Change::kFriction && t < 1) continue;  // the first slip is a step by design
    worst_N = std::max(worst_N, out.telemetry.step_raw_N - moved);
  }
}

}  // namespace

MaterialRow measure_materials(double rate_hz) {
  MaterialRow row;
  row.energy_min_J = std::numeric_limits<double>::infinity();
  measure_change(Change::kBorder, rate_hz, row.border_N, row.energy_min_J);
  measure_change(Change::kFlicker, rate_hz, row.flicker_N, row.energy_min_J);
  measure_change(Change::kFriction, rate_hz, row.friction_N, row.energy_min_J);
  measure_change(Change::kAmplitude, rate_hz, row.amplitude_N, row.energy_min_J);
  measure_change(Change::kPeriod, rate_hz, row.period_N, row.energy_min_J);
  return row;
}

TextureRow measure_texture(double stiffness) {
  TextureRow row{stiffness};
  constexpr double kSpeed = 0.01, kPeriod_s = 1e-3;
  std::vector<Vec3> way{{0.0003, 0.0007, 0.002}, {0.0003, 0.0007, -0.001}};
  for (int i = 0; i < 10; ++i) {
    for (const Vec3& step :
         {Vec3(0, 0, -0.001), Vec3(0.001, 0, 0), Vec3(0, 0, 0.001), Vec3(-0.001, 0, 0)}) {
      way.push_back(way.back() + step);
    }
  }
  for (const bool normal : {false, true}) {
    rt::Startup startup;
    tasks::HapticConfig config = loop_config(stiffness, true);
    config.texture_amplitude_m = 3e-4;
    config.texture_period_m = 2e-3;
    config.bump_normal = normal;
    drivers::DeviceProperties device;
    device.damping_N_s_per_m = 1e12;
    tasks::HapticTask task(startup.token(), config, device, kPeriod_s);
    const auto floor = std::make_unique<SurfacePatch>();
    floor->seq = 1;
    fill_floor(*floor, 16, [](int) { return 0; });
    tasks::HapticTask::In in;
    tasks::HapticTask::Out out;
    in.mode.seq = 1;
    in.mode.mode = tasks::Mode::kHold;
    in.stylus_ok = true;
    in.stylus.state = drivers::DeviceState::kForce;
    rt::Tick tick;
    tick.period = rt::Nanos{1000000};
    double energy = 0;
    Vec3 last = Vec3::Zero(), before = way.front();
    for (std::size_t leg = 1; leg < way.size(); ++leg) {
      const Vec3 from = way[leg - 1], to = way[leg];
      const auto ticks = static_cast<int>(std::lround((to - from).norm() / (kSpeed * kPeriod_s)));
      for (int i = 1; i <= ticks; ++i) {
        in.patch_newest = task.wants_patch() ? floor.get() : nullptr;
        in.stylus.p_DH = from + (static_cast<double>(i) / ticks) * (to - from);
        tick.release = tick.start = rt::time_from_ns(static_cast<std::int64_t>(++tick.k) * 1000000);
        (void)task.step(tick, in, out);
        if (leg > 1) energy += 0.5 * (out.force.f_H_D + last).dot(in.stylus.p_DH - before);
        last = out.force.f_H_D;
        before = in.stylus.p_DH;
      }
    }
    (normal ? row.normal_J : row.height_J) = std::abs(energy);
  }
  return row;
}

}  // namespace teletact
