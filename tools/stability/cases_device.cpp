// The closed loop: the device as a body (body.hpp) on the surfaces of other cases, pushed by a steady force without a hand
// or led by one, and a surface that steps under it.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "tests/support/haptic_solids.hpp"
#include "tools/stability/body.hpp"
#include "tools/stability/case_text.hpp"
#include "tools/stability/cases.hpp"
#include "tools/stability/judges.hpp"

namespace stability {

namespace {

// The device's own limit, a hair below it, and at most what its force limit makes sense of.
double stiffness_of(const Body& body) {
  return 0.8 * body.damping / (kPeriod / 2 + body.delay * kPeriod) * (1 - 1e-9);
}

// Largest force of the controller: what was sent before the guard beyond the spring, where neither
// limit nor fade has a part.
double controller_force(const Rig& r, const std::vector<Row>& rows) {
  double most = 0;
  for (const Row& row : rows) {
    const Vec3 spring = r.setup().config.stiffness_N_per_m * (row.p - row.h);
    if (!row.telemetry.in_contact || row.telemetry.gain < 1 || spring.norm() > 11.9) continue;
    most = std::max(most, (row.f_raw - spring).norm());
  }
  return most;
}

// `paid`: share of the credit.
double least_energy(const std::vector<Row>& rows, double paid = 1) {
  double least = 0;
  for (const Row& row : rows) {
    least = std::min(
        least, row.telemetry.energy_J + row.telemetry.booked_J + paid * row.telemetry.credit_J);
  }
  return least;
}

struct Place {
  const char* name;
  double (*solid)(const Vec3&);
  Vec3 start, push;              // of the push without a hand
  std::vector<Vec3> points;      // of the hand's way
  Vec3 (*nearest)(const Vec3&);  // free point of the true solid, near `start`
};
Vec3 on_floor(const Vec3& h) { return {h.x(), h.y(), std::max(h.z(), 0.0)}; }
Vec3 in_corner(const Vec3& h) { return {std::min(h.x(), 0.0), h.y(), std::max(h.z(), 0.0)}; }

// Without a hand nothing holds the device against a slope, and the samples of a convex edge slope from a voxel and
// more before it: there it is pushed where they are flat. A hand takes it over the edge itself.
std::vector<Place> places() {
  return {{"floor",
           solids::floor,
           {0, 0, 0.001},
           {0, 0, -3},
           {{-0.03, 0, 0.005}, {-0.03, 0, -0.008}, {0.03, 0, -0.008}, {0.03, 0, 0.01}},
           on_floor},
          {"corner",
           solids::concave_edge,
           {-0.001, 0, 0.001},
           Vec3(1, 0, -1).normalized() * 3,
           {{-0.03, 0, 0.005}, {-0.03, 0, -0.008}, {0.008, 0, -0.008}, {0.008, 0, 0.02}},
           in_corner},
          {"edge",
           solids::convex_edge,
           {-0.03, 0, 0.001},
           {0, 0, -3},
           {{-0.04, 0, 0.005}, {-0.04, 0, -0.008}, {0.02, 0, -0.008}},
           on_floor}};
}

struct Pushed {
  double residual = 0;       // speed after 7 s
  double ideal = 0;          // that of the true solid's spring, without field, proxy or guard
  Vec3 rest = Vec3::Zero();  // where it was when it was kicked
};

// A steady push against the surface, no hand: how fast the device still moves after 7 s. `steady`: it begins at rest where
// push and spring balance, kicked by 10 mm/s (as the boundary is measured, docs/stability.md); else it falls onto the
// surface, and a loop that only just damps has more than 7 s to go, whatever renders it.
//
// The samples of a corner are not the corner: their crease winds along it, and the push rests only in a hollow of that. The device
// comes there by itself, damped enough for it, before it is let go. A push that is tilted along the crease instead, to hold one given place,
// pulls a device without friction along for ever.
constexpr double kKick = 0.01, kSettling_N_s_per_m = 5;

template <class Force>
double residual_of(Twin& twin, const Vec3& push, const Force& force) {
  double worst = 0;
  for (int k = 0; k < 7000; ++k) {
    twin.advance(force(twin.reading()), push, Vec3::Zero(), Vec3::Zero());
    if (k >= 6900) worst = std::max(worst, twin.velocity().norm());
  }
  return worst;
}

// To rest from `from`, at most 10 s long; at rest is slower than 0.1 mm/s for 0.2 s.
template <class Force>
Vec3 settled(const Body& body, const Vec3& from, const Vec3& push, const Force& force) {
  Twin slow({body.mass, kSettling_N_s_per_m, 0, body.delay}, {}, from);
  slow.settled(-push, Vec3::Zero());
  for (int k = 0, calm = 0; k < 10000 && calm < 200; ++k) {
    slow.advance(force(slow.reading()), push, Vec3::Zero(), Vec3::Zero());
    calm = slow.velocity().norm() < 1e-4 ? calm + 1 : 0;
  }
  return slow.position();
}

Pushed pushed(const Setting& s, const Place& place, const Body& body, double stiffness,
              bool steady) {
  Rig r(held(s, place.solid, body, stiffness));
  const auto force = [&](const Vec3& h) { return r.tick(h).f; };
  const auto spring = [&](const Vec3& h) { return Vec3(stiffness * (place.nearest(h) - h)); };
  const Vec3 balance = place.nearest(place.start + place.push) + place.push / stiffness;
  Pushed out;
  out.rest = place.start;
  if (steady) {  // led there until the fade-in is over
    const Path down({place.start, balance}, 0.1);
    for (int k = 0; k < 300; ++k) (void)force(down(1e-3 * k));
    out.rest = settled(body, balance, place.push, force);
  }
  Twin twin(body, {}, out.rest), ideal(body, {}, steady ? balance : place.start);
  if (steady) {
    const Vec3 kick = kKick * place.push.normalized();
    twin.settled(force(twin.reading()), kick);
    ideal.settled(-place.push, kick);
  }
  out.residual = residual_of(twin, place.push, force);
  out.ideal = residual_of(ideal, place.push, spring);
  return out;
}

// The same on the field optimum from the same place: seconds of CPU, so only where the limit was missed.
double pushed_optimum(const Setting& s, const Place& place, const Body& body, double stiffness,
                      const Vec3& rest) {
  const Rig r(held(s, place.solid, body, stiffness));
  std::vector<Row> box(2);
  for (const double side : {-0.03, 0.03}) {
    Row& row = box[side > 0 ? 1 : 0];
    row.h = row.p = s.place.X_WS.inverse() * Vec3(s.place.X_WS * rest + Vec3::Constant(side));
  }
  const support::ReferenceField field = rig::reference_field(r, box);
  const support::FieldOptimum optimum(field, 0, r.setup().voxel);
  Vec3 last = s.place.X_WS * place.start, p = last;
  const auto force = [&](const Vec3& h_S) {
    const Vec3 h = s.place.X_WS * h_S;
    if (h != last) p = optimum.follow(p, last, h);
    last = h;
    return Vec3(stiffness * (s.place.X_WS.linear().transpose() * (p - h)));
  };
  Twin twin(body, {}, rest);
  twin.settled(force(twin.reading()), kKick * place.push.normalized());
  return residual_of(twin, place.push, force);
}

struct Held {
  std::vector<Row> rows;
  double residual = 0, controller = 0, energy = 0;
  std::optional<Twin> then;  // the device and the hand as they were at `then_s` of along()
};
// The hand's goal goes along the way, then rests: so long after the last event the device has to be at rest.
constexpr double kRest_s = 2, kRestAtLimit_s = 7;  // damped well; where the loop only just damps
// Slower for so long, it stays at rest.
constexpr int kCalmTicks = 500;
constexpr double kCalm_m_per_s = 1e-3;
Held along(Rig& r, const Body& body, const Grip& grip, const Path& path, double event_s,
           double rest_s, double then_s = 0) {
  Held out;
  Twin twin(body, grip, path(0));
  const auto event = static_cast<int>(std::ceil(event_s / kPeriod)),
             last = event + static_cast<int>(rest_s / kPeriod);
  std::vector<double> speed;
  for (int k = 0, calm = 0; k < last && calm < kCalmTicks; ++k) {
    const double t = k * kPeriod;
    if (!out.then && t > then_s - 0.5 * kPeriod) out.then = twin;
    out.rows.push_back(r.tick(twin.reading()));
    const Vec3 goal = path(t);
    twin.advance(out.rows.back().f, Vec3::Zero(), goal, (path(t + kPeriod) - goal) / kPeriod);
    speed.push_back(twin.velocity().norm());
    calm = k > event && speed.back() < kCalm_m_per_s ? calm + 1 : 0;
  }
  out.residual = *std::max_element(speed.end() - 100, speed.end());
  out.controller = controller_force(r, out.rows);
  out.energy = least_energy(out.rows);
  return out;
}

constexpr Grip kGrips[3] = {{0.1, 1, 100}, {0.3, 5, 400}, {1.0, 10, 1000}};

// The largest of each figure over hands.
struct Worst {
  double residual = 0, controller = 0, energy = 0;
  void take(const Held& h) {
    residual = std::max(residual, h.residual);
    controller = std::max(controller, h.controller);
    energy = std::min(energy, h.energy);
  }
};

Held led(const Setting& s, const Place& place, const Body& body, const Grip& grip, double stiffness,
         double rest_s, bool controller, double credit_of = 1) {
  Scene scene = held(s, place.solid, body, stiffness);
  scene.config.passivity_controller = controller;
  scene.config.credit_N_s_per_m *= credit_of;
  Rig r(std::move(scene));
  const Path path(place.points, s.speed);
  return along(r, body, grip, path, path.duration(), rest_s);
}

// Without a hand: at the largest stiffness of four devices, and at 1 N/mm on a light one.
void add_pushes(Run& run, const Setting& s, const Place& place) {
  const auto optimum_of = [&](const Pushed& p, const Body& body, double stiffness) {
    return 1e3 * (p.residual > 0.003 ? pushed_optimum(s, place, body, stiffness, p.rest) : p.ideal);
  };
  Pushed most;
  Body worst;
  for (const double b : {0.5, 2.0}) {
    for (const int delay : {0, 1}) {
      const Body body{0.2, b, 0, delay};
      const Pushed p = pushed(s, place, body, stiffness_of(body), true);
      if (p.residual < most.residual) continue;
      most = p;
      worst = body;
    }
  }
  add(run, "residual speed at 0.8 b/(T/2+t_d) mm/s", 1e3 * most.residual, 3,
      optimum_of(most, worst, stiffness_of(worst)));
  const Body light{0.2, 0.63, 0, 0};
  const Pushed wall = pushed(s, place, light, 1000, true);
  add(run, "residual speed at b 0.63, 1 N/mm, mm/s", 1e3 * wall.residual, 3,
      optimum_of(wall, light, 1000));
  const Pushed fall = pushed(s, place, light, 1000, false);
  run.note = text("fallen onto the surface at b 0.63: %.1f mm/s left, an ideal spring %.1f",
                  1e3 * fall.residual, 1e3 * fall.ideal);
}

// In each hand: each device at its largest stiffness and a light one at 1 N/mm, without the controller; with it what it
// does, and that it keeps the energy.
void add_hands(Run& run, const Setting& s, const Place& place) {
  constexpr double kBrief_s = 0.3;
  Worst bare, light, active, limber, firm;
  for (const Grip& grip : kGrips) {
    for (const double b : {0.5, 2.0}) {
      for (const int delay : {0, 1}) {
        const Body body{0.2, b, 0, delay};
        bare.take(led(s, place, body, grip, stiffness_of(body), kRestAtLimit_s, false));
        active.take(led(s, place, body, grip, stiffness_of(body), kBrief_s, true));
        if (active.energy < -1e-3)
          std::fprintf(stderr, "%s b %g delay %d grip %g: %g\n", run.name.c_str(), b, delay,
                       grip.stiffness, active.energy);
      }
    }
    const Body limp{0.2, 0.63, 0, 0};
    light.take(led(s, place, limp, grip, 1000, kRestAtLimit_s, false));
    for (const double c : {0.0, 0.3}) {
      limber.take(led(s, place, {0.2, 0.63, c, 0}, grip, 1000, kBrief_s, true));
      Held h = led(s, place, {0.2, 2, c, 0}, grip, 1000, kRest_s, true);
      firm.take(h);
      run.rows = std::move(h.rows);
    }
  }
  // Printed: a device that is known to dissipate nothing, and one with a third of the damping that is stated.
  double nothing = 0, third = 0, third_N = 0;
  for (const Grip& grip : kGrips) {
    nothing =
        std::min(nothing, led(s, place, {0.2, 2, 0, 0}, grip, 1000, kBrief_s, true, 0).energy);
    const Held h = led(s, place, {0.2, 2.0 / 3, 0, 0}, grip, 1000, kBrief_s, true, 3);
    third = std::min(third, least_energy(h.rows, 1.0 / 3));
    third_N = std::max(third_N, h.controller);
  }
  run.note += text(
      "; at 1 N/mm credited with 0: least E + booked %.2f mJ; with 3 times its b: with its own "
      "%.2f, controller %.2f N",
      1e3 * nothing, 1e3 * third, third_N);
  run.figures = rig::figures(run.rows);
  add_gates(run);
  add(run, "residual speed in a hand at 0.8 b/(T/2+t_d) mm/s", 1e3 * bare.residual, 3);
  add(run, "residual speed in a hand at b 0.63, 1 N/mm, mm/s", 1e3 * light.residual, 3);
  add(run, "residual speed in a hand mm/s", 1e3 * firm.residual, 3);
  add(run, "E + booked + credit below zero mJ",
      -1e3 * std::min({active.energy, limber.energy, firm.energy}), 1);
  add(run, "controller N", std::max(limber.controller, firm.controller), 1);
}

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

// What such a rise from its publication on puts into an exact spring under this device in this hand.
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

// What a step has to put into the spring: by an even rise over one period of windows, as the blend is, and the least of any
// that arrive within the 50 ms of case 12 in steps of at most 0.3 N. From device and hand as they are at the
// publication, and as an exact spring would have led them there, whichever takes less.
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

// The surface steps 5 mm up under a hand that holds on.
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

}  // namespace

Scene held(const Setting& s, std::function<double(const Vec3&)> solid, const Body& body,
           double stiffness) {
  Scene scene = still_scene(s, std::move(solid));
  scene.config.stiffness_N_per_m = stiffness;
  scene.device.mass_kg = body.mass;
  scene.device.damping_N_s_per_m = body.damping;
  scene.device.coulomb_N = body.coulomb;
  scene.device.delay_s = body.delay * kPeriod;
  scene.config.credit_N_s_per_m = body.damping;
  return scene;
}

std::vector<Run> case_closed_loop(const Setting& s) {
  std::vector<Run> out;
  for (const Place& place : places()) {
    Run run;
    run.id = 20;
    run.name = title(place.name, s);
    add_pushes(run, s, place);
    add_hands(run, s, place);
    out.push_back(std::move(run));
  }
  for (const Grip& grip : kGrips) {
    for (const double depth : {0.002, 0.008}) out.push_back(stepped(s, grip, depth));
  }
  return out;
}

}  // namespace stability
