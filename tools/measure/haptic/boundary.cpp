#include "tools/measure/haptic/boundary.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "drivers/omega/omega_twin.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/measure/haptic/boundary_floor.hpp"

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kPush_N = 3, kKick_m_per_s = 0.01, kQuiet_m_per_s = 0.003;

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
  // Holds the device with a known force until the delayed commands carry it, then lets the task
  // take over.
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
    // A swing of ten times the kick has grown, and will not come to rest. (A hand moves faster at
    // first.)
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
  // Where the encoder step is a large part of the stretch, its limit cycles make single stiffnesses
  // below the limit restless, and a bisection may end there: the largest is asked for.
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
    config.credit_N_s_per_m = s.damping;
    Loop loop(s, config, kPush_N / stiffness);
    loop.settle(Vec3(0, 0, -kPush_N));
    loop.twin().push(Vec3(0, 0, -kKick_m_per_s));
    // The run begins pressed in: what the spring then holds is booked by the task's first tick.
    double lowest = std::numeric_limits<double>::infinity();
    const auto ticks = static_cast<std::int64_t>(seconds * s.rate_hz);
    for (std::int64_t k = 0; k < ticks; ++k) {
      loop.tick();
      const auto& t = loop.telemetry();
      lowest = std::min(lowest, t.energy_J + t.booked_J + t.credit_J);
      if (on) row.controller_max_N = std::max(row.controller_max_N, t.controller_N);
      if (loop.braked()) break;
    }
    (on ? row.energy_min_J : row.energy_min_off_J) = lowest;
    if (on) row.speed_m_per_s = loop.twin().true_velocity().norm();
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

}  // namespace teletact
