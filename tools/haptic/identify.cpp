#include "tools/haptic/identify.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include <Eigen/Dense>

namespace teletact {

using perception::Vec3;

namespace {

constexpr int kSteps = 20;  // of the integration in a tick
using Parameters = Eigen::Vector4d;  // log m, log b, c, bias

struct Model {
  double mass, damping, coulomb, bias;
  explicit Model(const Parameters& p)
      : mass(std::exp(p[0])), damping(std::exp(p[1])), coulomb(std::max(p[2], 0.0)), bias(p[3]) {}
};

// Positions at the ticks of a ring under the commands as they were. Within a step the damped motion is exact;
// dry friction acts against the velocity, holds below its limit and never turns the motion round.
void simulate(const Ring& ring, const Model& m, double delay_s, std::vector<double>& out) {
  const double h = ring.period_s / kSteps;
  const double decay = std::exp(-m.damping / m.mass * h);
  const double reach = (1 - decay) * m.mass / m.damping;  // of one step from velocity 1
  const auto late = static_cast<std::int64_t>(std::llround(delay_s / h));
  double x = ring.samples.front().x_m, v = 0;
  out.clear();
  for (std::size_t k = 0; k < ring.samples.size(); ++k) {
    out.push_back(x);
    for (int i = 0; i < kSteps; ++i) {
      const std::int64_t at = static_cast<std::int64_t>(k) * kSteps + i - late;
      double f = at < 0 ? 0 : ring.samples[static_cast<std::size_t>(at / kSteps)].u_N;
      f += m.bias;
      if (v == 0) {
        if (std::abs(f) <= m.coulomb) continue;
        f -= std::copysign(m.coulomb, f);
      } else {
        f -= std::copysign(m.coulomb, v);
      }
      const double end = f / m.damping, from = v - end;  // velocity towards which it goes
      x += end * h + from * reach;
      v = end + from * decay;
      if (m.coulomb > 0 && from + end != 0 && (from + end) * v < 0) v = 0;
    }
  }
}

// Residuals of all rings, one after the other.
Eigen::VectorXd residuals(const std::vector<Ring>& rings, const Parameters& p, double delay_s) {
  std::size_t n = 0;
  for (const Ring& r : rings) n += r.samples.size();
  Eigen::VectorXd out(static_cast<Eigen::Index>(n));
  Eigen::Index at = 0;
  std::vector<double> x;
  for (const Ring& r : rings) {
    simulate(r, Model(p), delay_s, x);
    for (std::size_t k = 0; k < x.size(); ++k) out[at++] = x[k] - r.samples[k].x_m;
  }
  return out;
}

// Mass, damping and friction from the first swings about the spring's middle.
Parameters from_peaks(const Ring& ring) {
  const auto& s = ring.samples;
  const double k = ring.stiffness_N_per_m;
  // Where the spring pulls no more; dry friction lets it come to rest elsewhere.
  const double rest = s.front().x_m + s.front().u_N / k;
  // Largest excursion between crossings of it; the start, at rest, is the first of them.
  std::vector<double> size{std::abs(s.front().x_m - rest)}, crossing;
  double side = s.front().x_m - rest;
  for (std::size_t i = 1; i < s.size() && crossing.size() < 6; ++i) {
    const double a = s[i].x_m - rest;
    if (a * side < 0) {
      crossing.push_back(static_cast<double>(i));
      size.push_back(0);
      side = a;
    }
    size.back() = std::max(size.back(), std::abs(a));
  }
  double mass = 0.2, damping = 1, coulomb = 0.02;
  if (crossing.empty()) return {std::log(mass), std::log(damping), coulomb, 0};
  const double half = crossing.size() > 1 ? (crossing[1] - crossing[0]) * ring.period_s
                                          : 2 * crossing[0] * ring.period_s;
  const double w = std::numbers::pi / half;
  double q = size[1] / size[0];
  coulomb = 0;
  if (size.size() > 2 && size[0] > size[1] && size[2] > 1e-4) {
    const double exact = (size[1] - size[2]) / (size[0] - size[1]);
    if (exact > q && exact < 0.99) {
      q = exact;
      coulomb = k * (q * size[0] - size[1]) / (1 + q);
    }
  }
  const double delta = -std::log(std::clamp(q, 0.02, 0.98)) / half;  // b / 2m
  mass = k / (w * w + delta * delta);
  damping = std::max(2 * mass * delta, 0.02);
  return {std::log(mass), std::log(damping), std::max(coulomb, 0.0), 0};
}

DeviceFit fit_from(const std::vector<Ring>& rings, double delay_s, Parameters p) {
  Eigen::VectorXd r = residuals(rings, p, delay_s);
  double cost = r.squaredNorm(), lambda = 1e-3;
  const Parameters step(1e-3, 1e-3, 1e-3, 1e-4);
  for (int round = 0; round < 80; ++round) {
    Eigen::MatrixXd J(r.size(), 4);
    for (int i = 0; i < 4; ++i) {
      Parameters ahead = p, behind = p;
      ahead[i] += step[i];
      behind[i] -= i == 2 ? std::min(step[i], p[2]) : step[i];
      J.col(i) = (residuals(rings, ahead, delay_s) - residuals(rings, behind, delay_s)) /
                 (ahead[i] - behind[i]);
    }
    const Eigen::Matrix4d H = J.transpose() * J;
    const Eigen::Vector4d g = J.transpose() * r;
    bool better = false;
    for (int attempt = 0; attempt < 12 && !better; ++attempt) {
      Eigen::Matrix4d damped = H;
      damped.diagonal() += lambda * H.diagonal() + Eigen::Vector4d::Constant(1e-18);
      Parameters next = p - Parameters(damped.ldlt().solve(g));
      next[2] = std::max(next[2], 0.0);
      if (!next.allFinite() || std::abs(next[0]) > 6 || std::abs(next[1]) > 8) {
        lambda *= 10;
        continue;
      }
      const Eigen::VectorXd trial = residuals(rings, next, delay_s);
      if (trial.squaredNorm() < cost) {
        better = true;
        const double gain = cost - trial.squaredNorm();
        p = next;
        r = trial;
        cost = trial.squaredNorm();
        lambda = std::max(lambda * 0.3, 1e-9);
        if (gain < 1e-8 * cost) round = 1000;
      } else {
        lambda *= 10;
      }
    }
    if (!better) break;
  }
  const Model m(p);
  return {m.mass, m.damping, m.coulomb, m.bias,
          std::sqrt(cost / static_cast<double>(r.size())), static_cast<int>(rings.size())};
}

// Dry friction makes the sum of squares rough: where the derivatives lead no further, steps along the axes do.
Parameters polished(const std::vector<Ring>& rings, double delay_s, Parameters p) {
  double least = residuals(rings, p, delay_s).squaredNorm();
  Parameters step(0.02, 0.1, 0.02, 0.005);
  for (int level = 0; level < 12; ++level) {
    bool better = false;
    for (int i = 0; i < 4; ++i) {
      for (const double side : {1.0, -1.0}) {
        Parameters q = p;
        q[i] += side * step[i];
        q[2] = std::max(q[2], 0.0);
        const double cost = residuals(rings, q, delay_s).squaredNorm();
        if (!(cost < least)) continue;
        least = cost;
        p = q;
        better = true;
        break;
      }
    }
    if (better) {
      --level;
    } else {
      step *= 0.5;
    }
    if (least < 1e-11 * static_cast<double>(rings.size() * rings.front().samples.size())) break;
    if (step[0] < 1e-5) break;
  }
  return p;
}

Parameters parameters_of(const DeviceFit& f) {
  return {std::log(f.mass_kg), std::log(f.damping_N_s_per_m), f.coulomb_N, f.bias_N};
}

}  // namespace

DeviceFit fit_rings(const std::vector<Ring>& rings, double delay_s) {
  std::size_t n = 0;
  double moved = 0;
  for (const Ring& r : rings) {
    n += r.samples.size();
    for (const RingSample& s : r.samples) moved = std::max(moved, std::abs(s.x_m));
  }
  if (n < 100 || moved < 1e-4) return {};
  // Dry friction makes valleys: begin where one of the rings' own peaks explains all rings best.
  Parameters best = from_peaks(rings.front());
  double least = residuals(rings, best, delay_s).squaredNorm();
  for (const Ring& r : rings) {
    for (const double share : {0.0, 0.5, 1.0}) {
      Parameters p = from_peaks(r);
      p[2] *= share;
      const double cost = residuals(rings, p, delay_s).squaredNorm();
      if (!(cost < least)) continue;
      least = cost;
      best = p;
    }
  }
  // From there with its friction, and from less and more of it.
  DeviceFit fit = fit_from(rings, delay_s, best);
  for (const double coulomb : {0.0, 0.5 * best[2], best[2] + 0.1}) {
    if (fit.residual_m < 1.5e-5) break;  // as good as the encoder
    Parameters p = best;
    p[2] = coulomb;
    const DeviceFit other = fit_from(rings, delay_s, p);
    if (other.residual_m < fit.residual_m) fit = other;
  }
  if (fit.residual_m < 1.5e-5) return fit;
  const DeviceFit last = fit_from(rings, delay_s, polished(rings, delay_s, parameters_of(fit)));
  return last.residual_m < fit.residual_m ? last : fit;
}

DeviceFit fit_rings_and_delay(const std::vector<Ring>& rings, double& delay_s) {
  // Steps of a twentieth of a tick are what the model resolves.
  const double h = rings.front().period_s / kSteps;
  double best_delay = 0;
  DeviceFit best = fit_rings(rings, 0);
  const auto attempt = [&](double d) {
    if (!(best.mass_kg > 0)) return;
    const DeviceFit f = fit_from(rings, d, parameters_of(best));
    if (f.mass_kg > 0 && f.residual_m < best.residual_m) {
      best = f;
      best_delay = d;
    }
  };
  for (int i = 1; i <= 20; ++i) attempt(0.00025 * i);
  const double middle = best_delay;
  for (double d = std::max(0.0, middle - 0.0002); d <= middle + 0.0002 + 1e-9; d += h) attempt(d);
  delay_s = best_delay;
  return best;
}

IdentifyResult identify_device(drivers::HapticDevice& device, const IdentifyOptions& o,
                               rt::Time start, const Pace& pace) {
  const drivers::DeviceProperties properties = device.properties();
  if (!properties.renders_force) throw std::runtime_error("identify: the device renders no force");
  const rt::Nanos period{std::llround(1e9 / o.rate_hz)};
  const auto ticks = static_cast<std::size_t>(o.seconds * o.rate_hz);
  rt::Time now = start;
  drivers::StylusSample sample;
  const auto read = [&] {
    pace(now);
    if (!device.sense(now, sample)) throw std::runtime_error("identify: the device gave no sample");
    if (sample.state == drivers::DeviceState::kReset) {
      throw std::runtime_error("identify: the device is not calibrated");
    }
  };
  // To rest: damped for a while, then without any force. That is where the swings begin.
  const auto rest = [&](double seconds) {
    const auto n = static_cast<std::size_t>(seconds * o.rate_hz);
    Vec3 v = Vec3::Zero(), last = Vec3::Zero();
    for (std::size_t k = 0; k < n; ++k) {
      read();
      if (k > 0) v += ((sample.p_DH - last) * o.rate_hz - v) * std::min(1.0, 250 / o.rate_hz);
      last = sample.p_DH;
      device.act(now, {k < n / 2 ? Vec3(-8 * v) : Vec3(Vec3::Zero())});
      now += period;
    }
  };
  std::array<std::vector<Ring>, 3> rings;
  rest(0.3);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double k : o.stiffness_N_per_m) {
      for (const double side : {1.0, -1.0}) {
        rest(1.2);
        read();
        const Vec3 from = sample.p_DH;
        Vec3 centre = from;
        // Towards the middle of the workspace, so that swings do not walk out of it.
        const double way = from[axis] * side > 0.5 * properties.workspace_radius_m ? -side : side;
        centre[axis] += way * o.throw_m;
        Ring ring{axis, k, 1 / o.rate_hz, {}};
        for (std::size_t i = 0; i < ticks; ++i) {
          read();
          if (sample.state != drivers::DeviceState::kForce && i > 2) {
            throw std::runtime_error(
                "identify: the device braked during a swing; try a smaller --throw");
          }
          const Vec3 f = k * (centre - sample.p_DH);
          device.act(now, {f});
          ring.samples.push_back({sample.p_DH[axis] - from[axis], f[axis]});
          now += period;
        }
        double moved = 0;
        for (const RingSample& s : ring.samples) moved = std::max(moved, std::abs(s.x_m));
        if (moved < 0.5 * o.throw_m) {
          throw std::runtime_error(
              "identify: it hardly moved: let go of the stylus, or use a larger --throw");
        }
        rings[static_cast<std::size_t>(axis)].push_back(std::move(ring));
      }
    }
  }
  rest(0.1);
  IdentifyResult r;
  r.delay_s = properties.delay_s;
  if (o.fit_delay) {
    (void)fit_rings_and_delay(rings[0], r.delay_s);
  }
  for (std::size_t a = 0; a < 3; ++a) {
    r.axes[a] = fit_rings(rings[a], r.delay_s);
    if (!(r.axes[a].mass_kg > 0)) {
      throw std::runtime_error("identify: the swings can not be fitted");
    }
    r.mean.mass_kg += r.axes[a].mass_kg / 3;
    r.mean.damping_N_s_per_m += r.axes[a].damping_N_s_per_m / 3;
    r.mean.coulomb_N += r.axes[a].coulomb_N / 3;
    r.mean.residual_m = std::max(r.mean.residual_m, r.axes[a].residual_m);
    r.mean.rings += r.axes[a].rings;
  }
  return r;
}

}  // namespace teletact
