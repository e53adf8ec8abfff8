// Case 20: a surface that steps under the device in a hand, and what such a step has to put into
// the spring.
#include <algorithm>
#include <cmath>

#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/closed_loop.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

// A rise by `step`: `ends` ticks at either end as fast as 0.3 N a tick allow, evenly between them.
struct Rise {
  int ticks, ends;
  double step, stiffness;
  [[nodiscard]] double height(int done) const {
    const double quick = 0.3 / stiffness, even = (step - 2 * ends * quick) / (ticks - 2 * ends);
    const int first = std::min(done, ends), last = std::max(0, done - (ticks - ends));
    return done >= ticks ? step : quick * (first + last) + even * (done - first - last);
  }
};

// What such a rise from its publication on puts into an exact spring under this device in this
// hand.
double injected_by_rise(Twin twin, const Path& path, double published_s, const Rise& rise) {
  double height = 0, stretch = std::max(-twin.reading().z(), 0.0), injected = 0;
  for (int k = 0; k < rise.ticks; ++k) {
    const double z = twin.reading().z(), before = height, t = published_s + k * kPeriod;
    height = rise.height(k + 1);
    const double last = stretch;
    stretch = std::max(height - z, 0.0);
    injected += 0.5 * rise.stiffness * (stretch + last) * (height - before);
    const Vec3 goal = path(t);
    twin.advance({0, 0, std::min(rise.stiffness * stretch, 12.0)}, Vec3::Zero(), goal,
                 (path(t + kPeriod) - goal) / kPeriod);
  }
  return injected;
}

// The device led there by an exact spring on the true surface.
Twin led_by_exact(Twin twin, const Path& path, double until_s, double stiffness) {
  for (double t = 0; t < until_s - 0.5 * kPeriod; t += kPeriod) {
    const Vec3 goal = path(t);
    const double f = std::min(stiffness * std::max(-twin.reading().z(), 0.0), 12.0);
    twin.advance({0, 0, f}, Vec3::Zero(), goal, (path(t + kPeriod) - goal) / kPeriod);
  }
  return twin;
}

// What a step has to put into the spring: by an even rise over one period of windows, as the blend
// is, and the least of any that arrive within the 50 ms of case 12 in steps of at most 0.3 N. From
// device and hand as they are at the publication, and as an exact spring would have led them there,
// whichever takes less.
struct Least {
  double even = 0, any = 0;
};
Least least_injected(const Twin& as_is, const Twin& led, const Path& path, double published_s,
                     double step, double stiffness) {
  constexpr int kPeriodTicks = 33, kMostTicks = 50;
  Least out{1e9, 1e9};
  for (const Twin& twin : {as_is, led}) {
    out.even = std::min(
        out.even, injected_by_rise(twin, path, published_s, {kPeriodTicks, 0, step, stiffness}));
    for (int ends = 0; 2 * ends * 0.3 < stiffness * step; ++ends) {
      for (int ticks = kPeriodTicks; ticks <= kMostTicks; ++ticks) {
        out.any = std::min(
            out.any, injected_by_rise(twin, path, published_s, {ticks, ends, step, stiffness}));
      }
    }
  }
  return out;
}

}  // namespace

Run stepped(const Setting& s, const Grip& grip, double depth) {
  constexpr double kStep = 0.005, kStiffness = 1000;
  const Body body{0.2, 2, 0, 0};
  Scene scene = held(s, solids::floor, body, kStiffness);
  scene.config.passivity_controller = true;
  scene.still = false;
  const Path path({{0, 0, 0.005}, {0, 0, -depth}}, s.speed);
  const double at = path.duration() + 0.6;
  scene.solid = [=](const Vec3& p, double t) { return solids::floor(p) - (t > at ? kStep : 0); };
  Rig r(std::move(scene));
  // A window of this tick is the first that has it.
  const double published = kPeriod * std::ceil(std::ceil(at * 30 + 1e-6) / 30 / kPeriod - 1e-6);
  Held h = along(r, body, grip, path, at, kRest_s, published);
  double before = 0, after = 0;
  for (const Row& row : h.rows) {
    (row.t <= at ? before : after) = row.telemetry.booked_J;
  }
  Run run;
  run.id = 20;
  run.name = title(text("step at %.0f mm, hand %.0f N/m", 1e3 * depth, grip.stiffness), s);
  run.rows = std::move(h.rows);
  run.figures = rig::figures(run.rows);
  add_gates(run);
  const Twin led = led_by_exact(Twin(body, grip, path(0)), path, published, kStiffness);
  const Least least = least_injected(*h.then, led, path, published, kStep, kStiffness);
  add(run, text("injected mJ, hand %.0f N/m", grip.stiffness), 1e3 * (after - before), 10,
      1e3 * least.any, Yardstick::kExact);
  // One that rises slowly lifts spring and hand, k K / (k + K) together, by the step.
  const double both = grip.stiffness * kStiffness / (grip.stiffness + kStiffness),
               deep = depth + kStep;
  run.note = text(
      "an exact spring on an even rise over one period takes %.2f mJ, on the best within 50 ms "
      "%.2f; lifted slowly %.1f, a hand that stands %.1f",
      1e3 * least.even, 1e3 * least.any, 1e3 * 0.5 * both * (deep * deep - depth * depth),
      1e3 * 0.5 * kStiffness * (deep * deep - depth * depth));
  add(run, "E + booked + credit below zero mJ", -1e3 * h.energy, 1);
  add(run, "residual speed in a hand mm/s", 1e3 * h.residual, 3);
  add_injected(run, kStiffness);
  add_pops(run, r, true);
  return run;
}

}  // namespace stability
