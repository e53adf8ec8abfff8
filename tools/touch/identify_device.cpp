// The swings of a device that nobody holds, and what they say of it.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include "tools/touch/ring_down.hpp"

namespace teletact {

using perception::Vec3;

namespace {

// Moves the device tick by tick. Each function goes on where the one before it ended.
class Swinging {
 public:
  Swinging(drivers::HapticDevice& device, const IdentifyOptions& o, rt::Time start,
           const Pace& pace)
      : device_(device),
        o_(o),
        pace_(pace),
        period_{std::llround(1e9 / o.rate_hz)},
        reach_m_(device.properties().workspace_radius_m),
        now_(start) {}

  // A device that answers frame by frame has no sample yet when it was just opened.
  void wait_for_sample() {
    constexpr double kFirst_s = 1;
    const auto first = now_ + rt::nanos_from_seconds(kFirst_s);
    for (pace_(now_); !device_.sense(now_, sample_) && now_ < first; pace_(now_)) {
      device_.act(now_, {});
      now_ += period_;
    }
  }

  // To rest: damped for a while, then without any force. That is where the swings begin.
  void rest(double seconds) {
    const auto n = static_cast<std::size_t>(seconds * o_.rate_hz);
    Vec3 v = Vec3::Zero(), last = Vec3::Zero();
    for (std::size_t k = 0; k < n; ++k) {
      read();
      if (k > 0) v += ((sample_.p_DH - last) * o_.rate_hz - v) * std::min(1.0, 250 / o_.rate_hz);
      last = sample_.p_DH;
      device_.act(now_, {k < n / 2 ? Vec3(-8 * v) : Vec3(Vec3::Zero())});
      now_ += period_;
    }
  }

  // From rest, on a spring whose middle lies aside along the axis.
  [[nodiscard]] Ring swing(int axis, double stiffness_N_per_m, double side) {
    rest(1.2);
    read();
    const Vec3 from = sample_.p_DH;
    Vec3 centre = from;
    // Towards the middle of the workspace, so that swings do not walk out of it.
    const double way = from[axis] * side > 0.5 * reach_m_ ? -side : side;
    centre[axis] += way * o_.throw_m;
    Ring ring{axis, stiffness_N_per_m, 1 / o_.rate_hz, {}};
    const auto ticks = static_cast<std::size_t>(o_.seconds * o_.rate_hz);
    for (std::size_t i = 0; i < ticks; ++i) {
      read();
      if (sample_.state != drivers::DeviceState::kForce && i > 2) {
        throw std::runtime_error("the device braked during a swing; try a smaller --throw");
      }
      const Vec3 f = stiffness_N_per_m * (centre - sample_.p_DH);
      device_.act(now_, {f});
      ring.samples.push_back({sample_.p_DH[axis] - from[axis], f[axis]});
      now_ += period_;
    }
    double moved = 0;
    for (const RingSample& s : ring.samples) moved = std::max(moved, std::abs(s.x_m));
    if (moved < 0.5 * o_.throw_m) {
      throw std::runtime_error("it hardly moved: let go of the stylus, or use a larger --throw");
    }
    return ring;
  }

 private:
  void read() {
    pace_(now_);
    if (!device_.sense(now_, sample_)) throw std::runtime_error("no sample: check cable and power");
    if (sample_.state == drivers::DeviceState::kReset) {
      throw std::runtime_error("the device is not calibrated (docs/devices.md)");
    }
  }

  drivers::HapticDevice& device_;
  const IdentifyOptions& o_;
  const Pace& pace_;
  rt::Nanos period_;
  double reach_m_;
  rt::Time now_;
  drivers::StylusSample sample_;
};

// By axis.
using Rings = std::array<std::vector<Ring>, 3>;

Rings swing_along_all(drivers::HapticDevice& device, const IdentifyOptions& o, rt::Time start,
                      const Pace& pace) {
  Rings rings;
  Swinging swinging(device, o, start, pace);
  swinging.wait_for_sample();
  swinging.rest(0.3);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double k : o.stiffness_N_per_m) {
      for (const double side : {1.0, -1.0})
        rings[static_cast<std::size_t>(axis)].push_back(swinging.swing(axis, k, side));
    }
  }
  swinging.rest(0.1);
  return rings;
}

}  // namespace

IdentifyResult identify_device(drivers::HapticDevice& device, const IdentifyOptions& o,
                               rt::Time start, const Pace& pace) {
  const drivers::DeviceProperties properties = device.properties();
  if (!properties.renders_force) throw std::runtime_error("this kind of device renders no force");
  const Rings rings = swing_along_all(device, o, start, pace);
  IdentifyResult r;
  // RMS of a rounding: 2.9 um at the Omega's 10 um, which kResidualMost_m allows for.
  r.residual_most_m = std::max(o.residual_most_m, 2 * properties.quantum_m / std::sqrt(12.0));
  r.delay_s = properties.delay_s;
  if (o.fit_delay) {
    (void)fit_rings_and_delay(rings[0], r.delay_s);
  }
  for (std::size_t a = 0; a < 3; ++a) {
    r.axes[a] = fit_rings(rings[a], r.delay_s);
    if (!(r.axes[a].mass_kg > 0)) {
      throw std::runtime_error("no model fits the swings: let go of the stylus and try again");
    }
    r.mean.mass_kg += r.axes[a].mass_kg / 3;
    r.mean.damping_N_s_per_m += r.axes[a].damping_N_s_per_m / 3;
    r.mean.coulomb_N += r.axes[a].coulomb_N / 3;
    r.mean.residual_m = std::max(r.mean.residual_m, r.axes[a].residual_m);
    r.mean.rings += r.axes[a].rings;
  }
  return r;
}

std::string poor_fit(const IdentifyResult& r) {
  for (std::size_t a = 0; a < 3; ++a) {
    if (r.axes[a].residual_m <= r.residual_most_m) continue;
    char text[300];
    std::snprintf(
        text, sizeof text,
        "residual %.0f um along %c, allowed up to %.0f: mass, damping, dry friction and a "
        "steady bias do not explain these swings, so nothing is written; hold nothing, run "
        "less beside, or try --fit-delay or --residual",
        1e6 * r.axes[a].residual_m, "xyz"[a], 1e6 * r.residual_most_m);
    return text;
  }
  return {};
}

}  // namespace teletact
