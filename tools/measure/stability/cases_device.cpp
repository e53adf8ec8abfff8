// The closed loop: the device as a body (body.hpp) on the surfaces of other cases, pushed by a
// steady force without a hand or led by one.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/measure/stability/case_text.hpp"
#include "tools/measure/stability/closed_loop.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace stability {

namespace {

// The device's own limit, a hair below it, and at most what its force limit makes sense of.
double stiffness_of(const Body& body) {
  return 0.8 * body.damping / (kPeriod / 2 + body.delay * kPeriod) * (1 - 1e-9);
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

// Without a hand nothing holds the device against a slope, and the samples of a convex edge slope
// from a voxel and more before it: there it is pushed where they are flat. A hand takes it over the
// edge itself.
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

// A steady push against the surface, no hand: how fast the device still moves after 7 s. `steady`:
// it begins at rest where push and spring balance, kicked by 10 mm/s (as the boundary is measured,
// docs/stability.md); else it falls onto the surface, and a loop that only just damps has more than
// 7 s to go, whatever renders it.
//
// The samples of a corner are not the corner: their crease winds along it, and the push rests only
// in a hollow of that. The device comes there by itself, damped enough for it, before it is let go.
// A push that is tilted along the crease instead, to hold one given place, pulls a device without
// friction along for ever.
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

// The same on the field optimum from the same place: seconds of CPU, so only where the limit was
// missed.
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

// A device that has a third of the damping that it states, and that is credited with what it
// states.
struct Mistaken {
  double energy_J = 0, controller_N = 0, residual_m_per_s = 0;
};
Mistaken mistaken(const Setting& s, const Place& place, double stiffness) {
  constexpr double kOfStated = 1.0 / 3;
  const Body stated{0.2, 2, 0, 0}, body{0.2, kOfStated * stated.damping, 0, 0};
  Mistaken out;
  for (const Grip& grip : kGrips) {
    Scene scene = held(s, place.solid, stated, stiffness);
    scene.config.passivity_controller = true;
    Rig r(std::move(scene));
    const Path path(place.points, s.speed);
    const Held h = along(r, body, grip, path, path.duration(), kRest_s);
    out.energy_J = std::min(out.energy_J, least_energy(h.rows, kOfStated));
    out.controller_N = std::max(out.controller_N, h.controller);
    out.residual_m_per_s = std::max(out.residual_m_per_s, h.residual);
  }
  return out;
}

// Printed: a device that is known to dissipate nothing, and one that dissipates less than it
// states. At 1 N/mm that one still pays for the spring, which is within its own limit (1.07 N/mm);
// at the stiffest that what it states admits (3.2 N/mm) it does not.
//
// Not asserted, for it misses the limits of the others. Of 81 runs at 3.2 N/mm the energy falls
// below -1 mJ in one, a corner at 20 mm/s: -1.22; in all 27 corners the softest hand is left
// swinging after 2 s, at 5 to 36 mm/s (limit 3). The controller does nothing there: it believes the
// credit. Rest is not the credit's doing alone: in the corner at 200 mm/s that was looked into
// (22.5 mm/s after 4 s) it is 23.3 credited with its own b, 22.5 without the controller, 0.5
// credited with nothing.
void note_credit(Run& run, const Setting& s, const Place& place) {
  const Body stated{0.2, 2, 0, 0};
  double nothing = 0;
  for (const Grip& grip : kGrips)
    nothing = std::min(nothing, led(s, place, stated, grip, 1000, 0.3, true, 0).energy);
  run.note += text("; at 1 N/mm credited with 0: least E + booked %.2f mJ", 1e3 * nothing);
  for (const double stiffness : {1000.0, stiffness_of(stated)}) {
    const Mistaken m = mistaken(s, place, stiffness);
    run.note += text(
        "; with a third of the stated b at %.1f N/mm: with its own %.2f, controller %.2f N, "
        "%.1f mm/s left",
        1e-3 * stiffness, 1e3 * m.energy_J, m.controller_N, 1e3 * m.residual_m_per_s);
  }
}

// In each hand: each device at its largest stiffness and a light one at 1 N/mm, without the
// controller; with it what it does, and that it keeps the energy.
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
  note_credit(run, s, place);
  run.figures = rig::figures(run.rows);
  add_gates(run);
  add(run, "residual speed in a hand at 0.8 b/(T/2+t_d) mm/s", 1e3 * bare.residual, 3);
  add(run, "residual speed in a hand at b 0.63, 1 N/mm, mm/s", 1e3 * light.residual, 3);
  add(run, "residual speed in a hand mm/s", 1e3 * firm.residual, 3);
  add(run, "E + booked + credit below zero mJ",
      -1e3 * std::min({active.energy, limber.energy, firm.energy}), 1);
  add(run, "controller N", std::max(limber.controller, firm.controller), 1);
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
