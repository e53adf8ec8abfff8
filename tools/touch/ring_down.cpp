#include "tools/touch/ring_down.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>

namespace teletact {

using perception::Vec3;

namespace {

constexpr int kSteps = 20;  // of the integration in a tick

struct Model {
  double mass, damping, coulomb, bias;
};

// A ring up to a little after it came to rest: what follows says nothing more, and in a model with
// too little friction would run away.
struct Swing {
  const Ring* ring;
  std::size_t ticks;
};

std::vector<Swing> swings_of(const std::vector<Ring>& rings) {
  std::vector<Swing> out;
  for (const Ring& r : rings) {
    const auto back = static_cast<std::size_t>(std::max(1L, std::lround(0.01 / r.period_s)));
    std::size_t last = 0;
    for (std::size_t k = back; k < r.samples.size(); ++k) {
      if (std::abs(r.samples[k].x_m - r.samples[k - back].x_m) > 2e-5) last = k;
    }
    out.push_back({&r, std::min(r.samples.size(), last + 2 * back)});
  }
  return out;
}

// Positions at the ticks of a ring under the commands as they were, from velocity v. Within a step
// the damped motion is exact; dry friction acts against the velocity, holds below its limit and
// never turns the motion round.
void simulate(const Swing& swing, const Model& m, double v, double delay_s,
              std::vector<double>& out) {
  const Ring& ring = *swing.ring;
  const double h = ring.period_s / kSteps;
  const double decay = std::exp(-m.damping / m.mass * h);
  const double reach = (1 - decay) * m.mass / m.damping;  // of one step from velocity 1
  const auto late = static_cast<std::int64_t>(std::llround(delay_s / h));
  double x = ring.samples.front().x_m;
  out.clear();
  for (std::size_t k = 0; k < swing.ticks; ++k) {
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

// ---- In closed form

// Slope of a cubic through the 13 samples about k (Savitzky and Golay 1964), m/s.
double speed_at(const Ring& ring, std::size_t k) {
  constexpr int kHalf = 6;
  double sum = 0;
  for (int i = 1; i <= kHalf; ++i) {
    const auto j = static_cast<std::size_t>(i);
    const double weight = (129175.0 * i - 4375.0 * i * i * i) / 3603600.0;
    sum += weight * (ring.samples[k + j].x_m - ring.samples[k - j].x_m);
  }
  return sum / ring.period_s;
}

// The equation of motion integrated once is linear in what is looked for:
//   m v + b (x - x_0) + c int sign(v) - g t + t_d u = int u       (t_d only if `delay_s` is asked for)
Model solve_linear(const std::vector<Swing>& swings, double known_delay_s, double* delay_s) {
  constexpr std::size_t kEdge = 6;
  Eigen::Index rows = 0;
  for (const Swing& s : swings) {
    if (s.ticks > 2 * kEdge) rows += static_cast<Eigen::Index>(s.ticks - 2 * kEdge);
  }
  Eigen::MatrixXd A(rows, delay_s != nullptr ? 5 : 4);
  Eigen::VectorXd y(rows);
  Eigen::Index row = 0;
  for (const Swing& s : swings) {
    if (s.ticks <= 2 * kEdge) continue;
    const Ring& r = *s.ring;
    const double T = r.period_s;
    std::vector<double> pushed{0};  // int u up to each tick
    for (const RingSample& sample : r.samples) pushed.push_back(pushed.back() + T * sample.u_N);
    const auto pushed_until = [&](double t) {
      const double k = std::clamp(t / T, 0.0, static_cast<double>(pushed.size() - 1));
      const auto i = std::min(static_cast<std::size_t>(k), pushed.size() - 2);
      return pushed[i] + (k - static_cast<double>(i)) * (pushed[i + 1] - pushed[i]);
    };
    double before = speed_at(r, kEdge);
    double signs = std::copysign(static_cast<double>(kEdge) * T, before);
    for (std::size_t k = kEdge; k + kEdge < s.ticks; ++k) {
      const double v = speed_at(r, k), t = static_cast<double>(k) * T;
      if (k > kEdge) signs += 0.5 * T * (std::copysign(1.0, before) + std::copysign(1.0, v));
      before = v;
      A(row, 0) = v;
      A(row, 1) = r.samples[k].x_m - r.samples.front().x_m;
      A(row, 2) = signs;
      A(row, 3) = -t;
      if (delay_s != nullptr) A(row, 4) = r.samples[k].u_N;
      y[row] = pushed_until(t - known_delay_s);
      ++row;
    }
  }
  Eigen::VectorXd p = A.colPivHouseholderQr().solve(y);
  if (p[2] < 0) {  // none: its column away
    A.col(2).setZero();
    p = A.colPivHouseholderQr().solve(y);
    p[2] = 0;
  }
  if (delay_s != nullptr) *delay_s = std::clamp(p[4], 0.0, 0.005);
  return {std::max(p[0], 0.005), std::max(p[1], 0.005), p[2], p[3]};
}

// ---- By least squares of the position

// log m, log b, c, bias, and of each ring the velocity it began with: a device without dry friction
// never quite comes to rest between two steps of its encoder.
using Parameters = Eigen::VectorXd;

Model model_of(const Parameters& p) {
  return {std::exp(p[0]), std::exp(p[1]), std::max(p[2], 0.0), p[3]};
}

Parameters parameters_of(const Model& m, std::size_t rings) {
  Parameters p = Parameters::Zero(static_cast<Eigen::Index>(4 + rings));
  p[0] = std::log(m.mass), p[1] = std::log(m.damping), p[2] = m.coulomb, p[3] = m.bias;
  return p;
}

class Residuals {
 public:
  Residuals(const std::vector<Swing>& swings, double delay_s) : swings_(swings), delay_s_(delay_s) {
    for (const Swing& s : swings) {
      begin_.push_back(rows_);
      rows_ += static_cast<Eigen::Index>(s.ticks);
    }
  }
  [[nodiscard]] Eigen::VectorXd operator()(const Parameters& p) {
    Eigen::VectorXd out(rows_);
    for (std::size_t i = 0; i < swings_.size(); ++i) of_ring(i, p, out);
    return out;
  }
  [[nodiscard]] Eigen::MatrixXd jacobian(const Parameters& p) {
    const double step[4] = {1e-3, 1e-3, 1e-3, 1e-4};
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(rows_, p.size());
    Eigen::VectorXd ahead(rows_), behind(rows_);
    for (Eigen::Index i = 0; i < p.size(); ++i) {
      Parameters q = p, r = p;
      const double d = i < 4 ? step[i] : 1e-4;
      q[i] += d;
      r[i] -= i == 2 ? std::min(d, p[2]) : d;
      for (std::size_t s = 0; s < swings_.size(); ++s) {
        if (i >= 4 && static_cast<Eigen::Index>(s) != i - 4) continue;  // that ring's own
        of_ring(s, q, ahead);
        of_ring(s, r, behind);
        const auto n = static_cast<Eigen::Index>(swings_[s].ticks);
        J.col(i).segment(begin_[s], n) =
            (ahead.segment(begin_[s], n) - behind.segment(begin_[s], n)) / (q[i] - r[i]);
      }
    }
    return J;
  }

 private:
  // Less its mean: where in an encoder step the ring began is not known, and shifts all of it.
  void of_ring(std::size_t i, const Parameters& p, Eigen::VectorXd& out) {
    const Swing& s = swings_[i];
    simulate(s, model_of(p), p[static_cast<Eigen::Index>(4 + i)], delay_s_, x_);
    double mean = 0;
    for (std::size_t k = 0; k < s.ticks; ++k) mean += x_[k] - s.ring->samples[k].x_m;
    mean /= static_cast<double>(s.ticks);
    for (std::size_t k = 0; k < s.ticks; ++k) {
      out[begin_[i] + static_cast<Eigen::Index>(k)] = x_[k] - s.ring->samples[k].x_m - mean;
    }
  }
  const std::vector<Swing>& swings_;
  double delay_s_;
  std::vector<Eigen::Index> begin_;
  Eigen::Index rows_ = 0;
  std::vector<double> x_;
};

struct Minimum {
  Parameters p;
  double cost = std::numeric_limits<double>::infinity();
};

// Levenberg-Marquardt.
Minimum fit_from(Residuals& residuals, Parameters p) {
  Eigen::VectorXd r = residuals(p);
  double cost = r.squaredNorm(), lambda = 1e-3;
  for (int round = 0; round < 60; ++round) {
    const Eigen::MatrixXd J = residuals.jacobian(p);
    const Eigen::MatrixXd H = J.transpose() * J;
    const Eigen::VectorXd g = J.transpose() * r;
    bool better = false;
    double gain = 0;
    for (int attempt = 0; attempt < 12 && !better; ++attempt) {
      Eigen::MatrixXd damped = H;
      damped.diagonal() += lambda * H.diagonal() + Eigen::VectorXd::Constant(p.size(), 1e-18);
      Parameters next = p - Parameters(damped.ldlt().solve(g));
      next[2] = std::max(next[2], 0.0);
      lambda *= 10;
      if (!next.allFinite() || std::abs(next[0]) > 6 || std::abs(next[1]) > 8) continue;
      const Eigen::VectorXd trial = residuals(next);
      if (!(trial.squaredNorm() < cost)) continue;
      better = true;
      gain = cost - trial.squaredNorm();
      p = next;
      r = trial;
      cost = trial.squaredNorm();
      lambda = std::max(lambda * 0.03, 1e-9);
    }
    if (!better || gain < 1e-6 * cost) break;
  }
  return {p, cost};
}

// Dry friction makes the sum of squares rough: where the derivatives lead no further, steps along
// the axes do.
Minimum polished(Residuals& residuals, Minimum m) {
  Parameters step = Parameters::Constant(m.p.size(), 1e-3);
  step[0] = 0.01, step[1] = 0.05, step[2] = 0.01, step[3] = 0.005;
  for (int level = 0; level < 8; ++level) {
    bool better = false;
    for (Eigen::Index i = 0; i < m.p.size(); ++i) {
      for (const double side : {1.0, -1.0}) {
        Parameters q = m.p;
        q[i] += side * step[i];
        q[2] = std::max(q[2], 0.0);
        const double cost = residuals(q).squaredNorm();
        if (!(cost < m.cost)) continue;
        m = {q, cost};
        better = true;
        break;
      }
    }
    if (!better) step *= 0.5;
  }
  return m;
}

DeviceFit result_of(const std::vector<Swing>& swings, const Minimum& best) {
  std::size_t n = 0;
  for (const Swing& s : swings) n += s.ticks;
  const Model m = model_of(best.p);
  return {m.mass,
          m.damping,
          m.coulomb,
          m.bias,
          std::sqrt(best.cost / static_cast<double>(n)),
          static_cast<int>(swings.size())};
}

bool swung(const std::vector<Ring>& rings, const std::vector<Swing>& swings) {
  std::size_t n = 0;
  double moved = 0;
  for (const Swing& s : swings) n += s.ticks;
  for (const Ring& r : rings) {
    for (const RingSample& s : r.samples) moved = std::max(moved, std::abs(s.x_m));
  }
  return n >= 100 && moved >= 1e-4;
}

// From the closed form, and with other shares of its dry friction as long as the positions are not
// explained.
Minimum fit_swings(const std::vector<Swing>& swings, const Model& start, double delay_s) {
  std::size_t n = 0;
  for (const Swing& s : swings) n += s.ticks;
  const double good = 1e-5 * 1e-5 * static_cast<double>(n);
  Residuals residuals(swings, delay_s);
  Minimum best = fit_from(residuals, parameters_of(start, swings.size()));
  for (const double change : {-0.01, 0.01, -0.05, 0.05}) {
    if (best.cost < good) return best;
    Model m = start;
    m.coulomb = std::max(0.0, start.coulomb + change);
    const Minimum other = fit_from(residuals, parameters_of(m, swings.size()));
    if (other.cost < best.cost) best = other;
  }
  if (best.cost < good) return best;
  const Minimum last = fit_from(residuals, polished(residuals, best).p);
  return last.cost < best.cost ? last : best;
}

}  // namespace

DeviceFit fit_rings(const std::vector<Ring>& rings, double delay_s) {
  const std::vector<Swing> swings = swings_of(rings);
  if (!swung(rings, swings)) return {};
  return result_of(swings, fit_swings(swings, solve_linear(swings, delay_s, nullptr), delay_s));
}

DeviceFit fit_rings_and_delay(const std::vector<Ring>& rings, double& delay_s) {
  delay_s = 0;
  const std::vector<Swing> swings = swings_of(rings);
  if (!swung(rings, swings)) return {};
  double about = 0;
  const Model start = solve_linear(swings, 0, &about);
  // Steps of a twentieth of a tick are what the model resolves.
  const double h = rings.front().period_s / kSteps;
  const double middle = std::round(about / h) * h;
  Minimum best;
  Parameters from = parameters_of(start, swings.size());
  for (int i = -4; i <= 4; ++i) {
    const double d = middle + i * h;
    if (d < -1e-12) continue;
    Residuals residuals(swings, d);
    const Minimum m = fit_from(residuals, from);
    if (!(m.cost < best.cost)) continue;
    best = m;
    from = m.p;
    delay_s = std::max(d, 0.0);
  }
  return result_of(swings, best);
}

}  // namespace teletact
