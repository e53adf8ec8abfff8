#include "tools/haptic/boundary.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "drivers/omega/omega_twin.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/plot/svg.hpp"

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kPush_N = 3, kKick_m_per_s = 0.01, kQuiet_m_per_s = 0.003;

// Solid below z = 0, about the origin; the material by slot_of(x index of the node in W).
template <class Slot>
void fill_floor(SurfacePatch& p, int nodes, const Slot& slot_of) {
  p.voxel_size = 0.01;
  p.metres_per_unit = static_cast<float>(0.05 / 32767.0);
  p.nodes = nodes;
  p.origin_node = {-nodes / 2, -nodes / 2, -nodes / 2};
  const int middle = nodes / 2;
  for (int x = 0; x < nodes; ++x) {
    for (int y = 0; y < nodes; ++y) {
      for (int z = 0; z < nodes; ++z) {
        const std::size_t i = p.index(x, y, z);
        const double d = std::clamp(0.01 * (z - middle), -0.05, 0.05);
        p.distance[i] = static_cast<std::int16_t>(std::lround(d / 0.05 * 32767));
        p.material[i] = static_cast<std::uint8_t>(slot_of(x - middle) + 1);
        p.set_free(i, d > 0);
      }
    }
  }
}

drivers::OmegaTwinConfig twin_of(const LoopSetting& s) {
  drivers::OmegaTwinConfig c;
  c.mass_kg = s.mass_kg;
  c.damping_N_s_per_m = s.damping;
  c.coulomb_N = s.coulomb_N;
  c.delay_s = s.delay_s;
  c.quantum_m = 1e-5;
  c.force_limit_N = 50;
  c.watchdog_s = 0.0319;
  if (!s.hand) c.hand_stiffness_N_per_m = 0;
  // A whole number of them in half a tick; between ticks the linear part is exact at any size.
  c.substep_us = s.rate_hz > 2000 ? 25 : 50;
  return c;
}

// Device and task, tick by tick, in virtual time.
class Loop {
 public:
  Loop(const LoopSetting& s, const tasks::HapticConfig& config, double depth_m)
      : setting_(s),
        hand_(startup_.token(), {}, {}),
        twin_(startup_.token(), twin_of(s), s.hand ? &hand_ : nullptr,
              Vec3(0, 0, -std::min(depth_m, 0.07))),
        task_(startup_.token(), config, unbounded(s), 1 / s.rate_hz) {
    floor_->seq = 1;
    fill_floor(*floor_, 24, [](int) { return 0; });
    in_.mode.seq = 1;
    in_.mode.mode = tasks::Mode::kHold;
    period_ = rt::Nanos{std::llround(1e9 / s.rate_hz)};
    now_ = rt::time_from_ns(1'000'000'000);
    twin_.enable_force(now_);
  }
  // Holds the device with a known force until the delayed commands carry it, then lets the task take over.
  void settle(const Vec3& push) {
    const auto late = static_cast<int>(std::ceil(setting_.delay_s * setting_.rate_hz - 1e-9));
    for (int i = 0; i < late + 4; ++i) {
      (void)twin_.sense(now_, in_.stylus);
      if (i == late) twin_.set_external_force(push);  // with the first force that balances it
      twin_.act(now_, {-push});
      now_ += period_;
    }
  }
  void tick() {
    in_.stylus_ok = twin_.sense(now_, in_.stylus);
    in_.patch_newest = task_.wants_patch() ? floor_.get() : nullptr;
    rt::Tick tick;
    tick.k = k_++;
    tick.release = tick.start = now_;
    tick.period = period_;
    (void)task_.step(tick, in_, out_);
    twin_.act(now_, out_.force);
    now_ += period_;
  }
  drivers::OmegaTwin& twin() { return twin_; }
  [[nodiscard]] const tasks::HapticTelemetry& telemetry() const { return out_.telemetry; }
  [[nodiscard]] bool braked() const { return twin_.state() != drivers::DeviceState::kForce; }

 private:
  static drivers::DeviceProperties unbounded(const LoopSetting& s) {
    drivers::DeviceProperties d;
    d.mass_kg = s.mass_kg;
    d.damping_N_s_per_m = 1e12;  // what is looked for is the limit
    return d;
  }
  LoopSetting setting_;
  rt::Startup startup_;
  drivers::HandScript hand_;
  drivers::OmegaTwin twin_;
  tasks::HapticTask task_;
  std::unique_ptr<SurfacePatch> floor_ = std::make_unique<SurfacePatch>();
  tasks::HapticTask::In in_;
  tasks::HapticTask::Out out_;
  rt::Nanos period_{};
  rt::Time now_{};
  std::uint64_t k_ = 0;
};

tasks::HapticConfig loop_config(double stiffness, bool layer) {
  tasks::HapticConfig c;
  c.stiffness_N_per_m = stiffness;
  c.patch_liveness_s = 1e9;  // the floor does not change
  c.fade_in_s = 0;           // the run begins pressed in
  c.guard = layer;
  return c;
}

std::string delay_text(const LoopSetting& s) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", s.delay_s * s.rate_hz);
  return text;
}

}  // namespace

double residual_speed(const LoopSetting& s, double stiffness, double seconds) {
  Loop loop(s, loop_config(stiffness, false), kPush_N / stiffness);
  loop.settle(Vec3(0, 0, -kPush_N));
  loop.twin().push(Vec3(0, 0, -kKick_m_per_s));
  const auto ticks = static_cast<std::int64_t>(seconds * s.rate_hz);
  const auto last = static_cast<std::int64_t>((seconds - 0.1) * s.rate_hz);
  double worst = 0;
  for (std::int64_t k = 0; k < ticks; ++k) {
    loop.tick();
    const double speed = loop.twin().true_velocity().norm();
    // A swing of ten times the kick has grown, and will not come to rest. (A hand moves faster at first.)
    if (loop.braked() || speed > (s.hand ? 100 : 10) * kKick_m_per_s) return speed;
    if (k >= last) worst = std::max(worst, speed);
  }
  return worst;
}

BoundaryRow find_boundary(const LoopSetting& s) {
  const double seconds = s.rate_hz > 1500 ? 30 : 7;
  double lo = 0.5 * s.bound(), hi = 2 * s.bound();
  const auto stable = [&](double k) { return residual_speed(s, k, seconds) < kQuiet_m_per_s; };
  while (stable(hi) && hi < 100 * s.bound()) {
    lo = hi;
    hi *= 2;
  }
  while (!stable(lo) && lo > 0.01 * s.bound()) {
    hi = lo;
    lo *= 0.5;
  }
  const auto bisect = [&] {
    while (hi / lo > 1.01) {
      const double mid = std::sqrt(lo * hi);
      (stable(mid) ? lo : hi) = mid;
    }
  };
  bisect();
  // Where the encoder step is a large part of the stretch, its limit cycles make single stiffnesses below the limit
  // restless, and a bisection may end there: the largest is asked for.
  for (double above = 1.04; above < 1.25; above += 0.04) {
    if (!stable(above * lo)) continue;
    lo *= above;
    hi = 1.04 * lo;
    bisect();
    above = 1;
  }
  return {s, lo};
}

PassivityRow measure_passivity(const LoopSetting& s, double stiffness, double seconds) {
  PassivityRow row{s, stiffness};
  for (const bool on : {false, true}) {
    tasks::HapticConfig config = loop_config(stiffness, true);
    config.passivity_controller = on;
    Loop loop(s, config, kPush_N / stiffness);
    loop.settle(Vec3(0, 0, -kPush_N));
    loop.twin().push(Vec3(0, 0, -kKick_m_per_s));
    // The run begins pressed in: what the spring then holds is booked by the task's first tick.
    double lowest = std::numeric_limits<double>::infinity();
    const auto ticks = static_cast<std::int64_t>(seconds * s.rate_hz);
    for (std::int64_t k = 0; k < ticks; ++k) {
      loop.tick();
      const auto& t = loop.telemetry();
      lowest = std::min(lowest, t.energy_J + t.booked_J);
      if (on) row.controller_max_N = std::max(row.controller_max_N, t.controller_N);
      if (loop.braked()) break;
    }
    (on ? row.energy_min_J : row.energy_min_off_J) = lowest;
    if (on) row.speed_m_per_s = loop.twin().true_velocity().norm();
  }
  return row;
}

namespace {

// What changes under the hand. Border and friction: the hand slides. Flicker and texture: the label flips with every
// window; under the texture the hand stands, since sliding over bumps turns the force by itself.
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

// Down to 8 mm at 50 mm/s; then 100 mm/s along x over the border and back; with friction at 20 mm/s one way, so that it
// slips all the time; on the texture from place to place, 0.5 s at each.
Vec3 material_hand(Change change, double t) {
  if (t < 0.26) return Vec3(-0.04, 0.001, 0.005 - 0.05 * t);
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
  return Vec3(-0.04 + x, 0.001, -0.008);
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

BoundaryResult bench_boundary(std::ostream& progress, const BoundaryOptions& o) {
  BoundaryResult r;
  for (const double rate : o.rates_hz) {
    progress << rate << " Hz\n";
    for (const double b : o.dampings) {
      for (const double ticks : o.delay_ticks) {
        LoopSetting s;
        s.rate_hz = rate, s.damping = b, s.delay_s = ticks / rate;
        r.rows.push_back(find_boundary(s));
        for (const double share : {0.5, 0.8, 1.0, 1.25, 2.0}) {
          r.passivity.push_back(measure_passivity(s, share * s.bound(), 3));
        }
      }
    }
    r.materials.emplace_back(rate, measure_materials(rate));
  }
  for (const double stiffness : {300.0, 1000.0}) r.textures.push_back(measure_texture(stiffness));
  if (!o.extra || o.rates_hz.empty()) return r;
  progress << "with dry friction and with a hand\n";
  for (const double b : o.dampings) {
    LoopSetting s;
    s.rate_hz = o.rates_hz.front(), s.damping = b;
    for (const double c : {0.1, 0.3}) {
      s.coulomb_N = c;
      r.rows.push_back(find_boundary(s));
    }
    s.coulomb_N = 0;
    s.hand = true;
    r.rows.push_back(find_boundary(s));
  }
  return r;
}

std::vector<BenchMetric> BoundaryResult::metrics() const {
  double low = std::numeric_limits<double>::infinity(), high = 0, energy = low, off = low, pc = 0;
  for (const BoundaryRow& row : rows) {
    if (!row.plain()) continue;
    low = std::min(low, row.ratio());
    high = std::max(high, row.ratio());
  }
  for (const PassivityRow& row : passivity) {
    energy = std::min(energy, row.energy_min_J);
    off = std::min(off, row.energy_min_off_J);
    pc = std::max(pc, row.controller_max_N);
  }
  double border = 0, flicker = 0, friction = 0, amplitude = 0, period = 0;
  for (const auto& [rate, m] : materials) {
    border = std::max(border, m.border_N);
    flicker = std::max(flicker, m.flicker_N);
    friction = std::max(friction, m.friction_N);
    amplitude = std::max(amplitude, m.amplitude_N);
    period = std::max(period, m.period_N);
    energy = std::min(energy, m.energy_min_J);
  }
  double loop = 0, normal = 0;
  for (const TextureRow& row : textures) {
    loop = std::max(loop, row.height_J);
    normal = std::max(normal, row.normal_J);
  }
  return {{"haptic.boundary.ratio_min", low, "1"},
          {"haptic.boundary.ratio_max", high, "1"},
          {"haptic.passivity.energy_min_mJ", 1e3 * energy, "mJ"},
          {"haptic.passivity.energy_min_off_mJ", 1e3 * off, "mJ"},
          {"haptic.passivity.controller_max_N", pc, "N"},
          {"haptic.materials.border_N", border, "N"},
          {"haptic.materials.flicker_N", flicker, "N"},
          {"haptic.materials.friction_N", friction, "N"},
          {"haptic.materials.amplitude_N", amplitude, "N"},
          {"haptic.materials.period_N", period, "N"},
          {"haptic.texture.loops_mJ", 1e3 * loop, "mJ"},
          {"haptic.bump_normal.loops_mJ", 1e3 * normal, "mJ"}};
}

void BoundaryResult::print(std::ostream& out) const {
  char line[320];
  out << "  rate   b      t_d    c     hand   K max      b/(T/2+t_d)  ratio\n"
         "  Hz     N s/m  ticks  N            N/m        N/m\n";
  for (const BoundaryRow& row : rows) {
    const LoopSetting& s = row.setting;
    std::snprintf(line, sizeof line, "  %-6.0f %-6.2f %-6s %-5.2f %-6s %-10.0f %-12.0f %.3f\n",
                  s.rate_hz, s.damping, delay_text(s).c_str(), s.coulomb_N, s.hand ? "yes" : "no",
                  row.stiffness_max, s.bound(), row.ratio());
    out << line;
  }
  out << "\npassivity, K as a share of b/(T/2+t_d); lowest E + booked\n"
         "  rate   b      t_d    share  off, mJ     on, mJ      controller N  speed at end mm/s\n";
  for (const PassivityRow& row : passivity) {
    const LoopSetting& s = row.setting;
    std::snprintf(line, sizeof line, "  %-6.0f %-6.2f %-6s %-6.2f %-11.3f %-11.3f %-13.2f %.2f\n",
                  s.rate_hz, s.damping, delay_text(s).c_str(), row.stiffness / s.bound(),
                  1e3 * row.energy_min_off_J, 1e3 * row.energy_min_J, row.controller_max_N,
                  1e3 * row.speed_m_per_s);
    out << line;
  }
  for (const auto& [rate, m] : materials) {
    std::snprintf(
        line, sizeof line,
        "\n%.0f Hz: raw step beyond the hand's motion: border 1.0/0.4 %.3f N, label that "
        "flips %.3f N, with it friction %.3f N, bumps' height %.3f N, period %.3f N; lowest "
        "E + booked %.3f mJ\n",
        rate, m.border_N, m.flicker_N, m.friction_N, m.amplitude_N, m.period_N,
        1e3 * m.energy_min_J);
    out << line;
  }
  for (const TextureRow& row : textures) {
    std::snprintf(line, sizeof line,
                  "bumps of 0.3 mm in 2 mm at %.1f N/mm, ten loops over 1 to 2 mm of depth: %.3f "
                  "mJ, as a perturbed "
                  "normal %.3f mJ\n",
                  1e-3 * row.stiffness, 1e3 * row.height_J, 1e3 * row.normal_J);
    out << line;
  }
}

std::string BoundaryResult::drawing() const {
  plot::Figure f;
  f.title = "Largest stable stiffness over b / (T/2 + t_d)";
  f.x_label = "b / (T/2 + t_d), N/m";
  f.y_label = "largest K, N/m";
  f.log_x = f.log_y = true;
  f.height_px = 460;
  double lo = std::numeric_limits<double>::infinity(), hi = 0;
  const auto series_of = [&](const std::string& name) -> plot::Series& {
    for (plot::Series& s : f.series) {
      if (s.name == name) return s;
    }
    f.series.push_back({name, {}, {}, "", true, false});
    return f.series.back();
  };
  for (const BoundaryRow& row : rows) {
    const LoopSetting& s = row.setting;
    char name[64];
    if (s.hand) {
      std::snprintf(name, sizeof name, "%.0f Hz, held by a hand", s.rate_hz);
    } else if (s.coulomb_N > 0) {
      std::snprintf(name, sizeof name, "%.0f Hz, c = %.1f N", s.rate_hz, s.coulomb_N);
    } else {
      std::snprintf(name, sizeof name, "%.0f Hz", s.rate_hz);
    }
    plot::Series& to = series_of(name);
    to.x.push_back(s.bound());
    to.y.push_back(row.stiffness_max);
    lo = std::min(lo, s.bound());
    hi = std::max(hi, s.bound());
  }
  f.series.push_back({"K = b / (T/2 + t_d)", {lo, hi}, {lo, hi}, "#333333", false, false});
  f.series.push_back({"20 % above and below",
                      {lo, hi, std::nan(""), lo, hi},
                      {0.8 * lo, 0.8 * hi, std::nan(""), 1.2 * lo, 1.2 * hi},
                      "#999999",
                      false,
                      false});
  return plot::line_plot(f);
}

}  // namespace teletact
