// Measures mass, damping and dry friction of a haptic device by ring-down. Nobody holds the device.
// A soft virtual spring pulls it aside and lets it swing about the new place, along each axis of D,
// with two stiffnesses.
//
//   model    m x'' = u + g - b x' - c sign(x'),   u = the force that was commanded, held over each tick and t_d late
//   start    in closed form: m x'' integrated once is linear in m, b, c, bias and (if asked for)
//            t_d
//   fit      least squares of the position (Levenberg-Marquardt) up to where each swing comes to
//            rest, the model integrated at 20 steps a tick under the commands as they were; t_d by
//            a search about its start
//
// The model contains what the spring's hold and delay add or take, so the result does not.
// Frames: D haptic base.  SI.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "drivers/haptic/haptic_device.hpp"

namespace teletact {

struct RingSample {
  double x_m = 0;  // along the axis, relative to the start
  double u_N = 0;  // commanded in this tick, along the axis
};

struct Ring {
  int axis = 0;
  double stiffness_N_per_m = 0, period_s = 1e-3;
  std::vector<RingSample> samples;
};

struct DeviceFit {
  double mass_kg = 0, damping_N_s_per_m = 0, coulomb_N = 0, bias_N = 0;
  double residual_m = 0;  // RMS of the position
  int rings = 0;
};

// If the residual exceeds this value and the device's quantisation, the model does not hold:
// somebody holds the arm, it falls, ticks are late, or ticks are too coarse for the device. Against
// twins: 3 to 12 um if the model holds, 47 and more if not.
inline constexpr double kResidualMost_m = 20e-6;

// Fits all rings of one axis together, with a known delay. Fewer than 100 samples, or no motion:
// mass 0.
[[nodiscard]] DeviceFit fit_rings(const std::vector<Ring>& rings, double delay_s);
// The same, the delay looked for between 0 and 5 ms; `delay_s` gets it.
[[nodiscard]] DeviceFit fit_rings_and_delay(const std::vector<Ring>& rings, double& delay_s);

struct IdentifyOptions {
  double rate_hz = 1000, seconds = 1.5;  // of each ring
  double throw_m = 0.012;                // how far the spring's centre goes
  std::vector<double> stiffness_N_per_m{100, 300};
  bool fit_delay = false;  // else the device's stated one counts
  double residual_most_m = kResidualMost_m;
};

struct IdentifyResult {
  std::array<DeviceFit, 3> axes;
  DeviceFit mean;  // of the axes; residual: the largest
  double delay_s = 0;
  double residual_most_m = kResidualMost_m;  // for this device's steps
};

// Empty, or one line: which axis fits worse than the model may.
[[nodiscard]] std::string poor_fit(const IdentifyResult& result);

// Called with the instant of each tick before it; real time sleeps in it.
using Pace = std::function<void(rt::Time)>;

// Throws std::runtime_error: no force, not in FORCE, brakes on the way, hardly any motion (somebody
// holds it).
[[nodiscard]] IdentifyResult identify_device(drivers::HapticDevice& device,
                                             const IdentifyOptions& options, rt::Time start,
                                             const Pace& pace);

}  // namespace teletact
