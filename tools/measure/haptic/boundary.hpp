// Where the closed loop of device and renderer is stable: the whole haptic task on a floor, in a
// loop with the twin of the device.
//
//   boundary   no Coulomb friction, no hand, 10 um quantum, motion between ticks exact; pressed by
//              3 N to where the forces balance, then kicked by 10 mm/s. The largest K, by bisection
//              to 1 %, at which the speed is below 3 mm/s after 7 s (1 kHz) or 30 s (2 and 4 kHz).
//              Guard and passivity controller off. Oracle: b / (T/2 + t_d)  (Colgate and Schenkel:
//              b > K T/2, with the delay added).
//   passivity  the same loop with the whole stability layer on, K from half to twice that bound:
//              the lowest E + booked of the run, E(k) = E(k-1) - F(k-1).(x(k) - x(k-1)).
//   materials  sliding over a border of 1.0 / 0.4 of the stiffness at 8 mm, and a label that flips
//              with every window: raw change of force a tick beyond K times the hand's motion.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct LoopSetting {
  double rate_hz = 1000;
  double damping = 1, delay_s = 0, coulomb_N = 0;  // of the device
  bool hand = false;                               // its hand model holds the stylus
  double mass_kg = 0.2;
  [[nodiscard]] double bound() const { return damping / (0.5 / rate_hz + delay_s); }
};

struct BoundaryRow {
  LoopSetting setting;
  double stiffness_max = 0;
  [[nodiscard]] double ratio() const { return stiffness_max / setting.bound(); }
  [[nodiscard]] bool plain() const { return setting.coulomb_N == 0 && !setting.hand; }
};

struct PassivityRow {
  LoopSetting setting;
  double stiffness = 0;
  double energy_min_J = 0;      // E + booked, controller on
  double energy_min_off_J = 0;  // the same, controller off
  double controller_max_N = 0;  // largest force of the controller
  double speed_m_per_s = 0;     // at the end, controller on
};

// Residual speed of one run, m/s: the largest of the last 0.1 s.
[[nodiscard]] double residual_speed(const LoopSetting& s, double stiffness, double seconds);
[[nodiscard]] BoundaryRow find_boundary(const LoopSetting& s);
[[nodiscard]] PassivityRow measure_passivity(const LoopSetting& s, double stiffness,
                                             double seconds);

struct MaterialRow {
  // Raw change beyond the hand's motion, largest: a border of stiffness, and a label that flips the
  // stiffness, the friction, the height or the period of the bumps.
  double border_N = 0, flicker_N = 0, friction_N = 0, amplitude_N = 0, period_N = 0;
  double energy_min_J = 0;  // E + booked, of all
};
[[nodiscard]] MaterialRow measure_materials(double rate_hz);

// What ten loops over 1 to 2 mm of depth and 1 mm along bumps of 0.3 mm in 2 mm cost at 10 mm/s, J:
// as a height, and as the published perturbed normal.
struct TextureRow {
  double stiffness = 0, height_J = 0, normal_J = 0;
};
[[nodiscard]] TextureRow measure_texture(double stiffness);

struct BoundaryOptions {
  std::vector<double> rates_hz{1000, 2000, 4000};
  std::vector<double> dampings{0.5, 1, 2, 4};
  std::vector<double> delay_ticks{0, 1, 2};
  bool extra = true;  // curves with dry friction and with a hand, at the first rate
};

struct BoundaryResult {
  std::vector<BoundaryRow> rows;
  std::vector<PassivityRow> passivity;
  std::vector<std::pair<double, MaterialRow>> materials;  // by rate
  std::vector<TextureRow> textures;
  // Boundary within 20 % of the formula; E + booked >= -1 mJ with the controller; materials change
  // the force by at most 0.15 N a tick beyond the hand's motion; ten loops over bumps, as a height,
  // cost at most 0.2 mJ.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  [[nodiscard]] std::string drawing() const;  // SVG: largest K over b / (T/2 + t_d)
};

[[nodiscard]] BoundaryResult bench_boundary(std::ostream& progress, const BoundaryOptions& options);

}  // namespace teletact
