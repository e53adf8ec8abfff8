#include "tools/measure/stability/closed_loop.hpp"

#include <algorithm>
#include <cmath>

#include "tools/measure/stability/case_text.hpp"

namespace stability {

namespace {

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

// Slower for so long, it stays at rest.
constexpr int kCalmTicks = 500;
constexpr double kCalm_m_per_s = 1e-3;

}  // namespace

double least_energy(const std::vector<Row>& rows, double paid) {
  double least = 0;
  for (const Row& row : rows) {
    least = std::min(
        least, row.telemetry.energy_J + row.telemetry.booked_J + paid * row.telemetry.credit_J);
  }
  return least;
}

Held along(Rig& r, const Body& body, const Grip& grip, const Path& path, double event_s,
           double rest_s, double then_s) {
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

}  // namespace stability
