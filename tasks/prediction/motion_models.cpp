#include "tasks/prediction/motion_models.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

Axes Motion::mean() const noexcept {
  Axes sum{};
  for (const Axes& p : part)
    for (std::size_t k = 0; k < 3; ++k) sum[k] += p[k];
  for (double& v : sum) v /= static_cast<double>(kParts);
  return sum;
}

Motion Motion::ramp(const Axes& start, const Axes& mean) noexcept {
  Motion out;
  for (std::size_t i = 0; i < kParts; ++i) {
    const double f = (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(kParts);
    for (std::size_t k = 0; k < 3; ++k) out.part[i][k] = start[k] + f * (mean[k] - start[k]);
  }
  return out;
}

bool ConstantVelocity::predict(const MotionHistory& history, double /*h*/,
                               Motion& out) const noexcept {
  out.part.fill(axes(history.newest().v_B));
  return true;
}

void AccelerationFilter::start(const MotionSample& s) noexcept {
  const Axes v = axes(s.v_B);
  for (std::size_t k = 0; k < 3; ++k) {
    const double r = config_.noise[k] * config_.noise[k];
    axis_[k] = {v[k], 0, r, 0, config_.jerk[k]};  // what a second of jerk makes
  }
  t_ = s.t;
  started_ = true;
}

void AccelerationFilter::add(const MotionHistory& history) noexcept {
  const MotionSample& s = history.newest();
  constexpr double kGap_s = 5;  // what was before it says nothing any more
  if (!started_ || s.t - t_ > kGap_s) return start(s);
  const double dt = s.t - t_, T = config_.time_s;
  t_ = s.t;
  // v' = v + g a, a' = e a; Q of white noise on the jerk.
  const double e = T > 0 ? std::exp(-dt / T) : 1, g = T > 0 ? T * (1 - e) : dt;
  const double q11 = T > 0 && dt > 1e-3 * T ? T * T * (dt - 2 * T * (1 - e) + 0.5 * T * (1 - e * e))
                                            : dt * dt * dt / 3;
  const double q12 = 0.5 * g * g, q22 = T > 0 ? 0.5 * T * (1 - e * e) : dt;
  const Axes z = axes(s.v_B);
  for (std::size_t k = 0; k < 3; ++k) {
    Axis& x = axis_[k];
    const double q = config_.jerk[k];
    x.v += g * x.a;
    x.a *= e;
    const double pvv = x.pvv + 2 * g * x.pva + g * g * x.paa + q * q11;
    const double pva = e * (x.pva + g * x.paa) + q * q12;
    const double paa = e * e * x.paa + q * q22;
    const double s2 = pvv + config_.noise[k] * config_.noise[k];
    const double kv = pvv / s2, ka = pva / s2, innovation = z[k] - x.v;
    x.v += kv * innovation;
    x.a += ka * innovation;
    x.pvv = (1 - kv) * pvv;
    x.pva = (1 - kv) * pva;
    x.paa = paa - ka * pva;
  }
}

bool AccelerationFilter::predict(const MotionHistory& /*history*/, double h,
                                 Motion& out) const noexcept {
  if (!started_) return false;
  const double T = config_.time_s;
  const auto way = [&](const Axis& x, double t) {  // integral of the velocity
    return T > 0 ? x.v * t + x.a * T * (t - T * (1 - std::exp(-t / T))) : (x.v + 0.5 * x.a * t) * t;
  };
  const double part = h / static_cast<double>(Motion::kParts);
  for (std::size_t k = 0; k < 3; ++k) {
    double before = 0;
    for (std::size_t i = 0; i < Motion::kParts; ++i) {
      const double now = way(axis_[k], static_cast<double>(i + 1) * part);
      out.part[i][k] = (now - before) / part;
      before = now;
    }
  }
  return true;
}

LinearModel::LinearModel(const Config& config) noexcept : config_(config) {
  config_.order = std::clamp<std::size_t>(config.order, 1, kLargestOrder);
  config_.rows = std::clamp<std::size_t>(config.rows, 1, kMostRows);
}

LinearFit LinearModel::fit(const MotionHistory& history) const noexcept {
  const std::size_t m = config_.order, size = history.size();
  const std::size_t n = size > m ? std::min(config_.rows, size - m) : 0;
  FitMatrix A(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(3 * m));
  FitOutputs B(static_cast<Eigen::Index>(n), 3);
  for (std::size_t r = 0; r < n; ++r) {
    const std::size_t k = size - 1 - r;
    for (std::size_t j = 0; j <= m; ++j) {
      const Axes v = axes(history.sample(k - j).v_B);
      for (std::size_t a = 0; a < 3; ++a) {
        const auto row = static_cast<Eigen::Index>(r), axis = static_cast<Eigen::Index>(a);
        if (j == 0)
          B(row, axis) = v[a];
        else
          A(row, static_cast<Eigen::Index>(3 * (j - 1)) + axis) = v[a];
      }
    }
  }
  return minimum_norm(A, B, config_.ridge);
}

bool LinearModel::predict(const MotionHistory& history, double h, Motion& out) const noexcept {
  const std::size_t m = config_.order, size = history.size();
  // Before there is a row for each unknown of an axis it is the last velocity.
  if (size < m + 2) return ConstantVelocity{}.predict(history, h, out);
  const LinearFit theta = fit(history);
  const std::size_t n = std::min(config_.rows + m, size - 1);
  const double period =
      (history.newest().t - history.sample(size - 1 - n).t) / static_cast<double>(n);
  std::array<Axes, kLargestOrder> past{};  // newest first
  for (std::size_t j = 0; j < m; ++j) past[j] = axes(history.sample(size - 1 - j).v_B);
  // The velocity at the samples to come, on lines between them; its integral in each quarter of the
  // horizon.
  const double part = h / static_cast<double>(Motion::kParts);
  out = {};
  out.condition = theta.condition;
  std::size_t quarter = 0;
  double t = 0, step = 0;  // t: integrated up to here; step: in the sample period
  Axes from = past[0], to = from;
  bool need = true;
  constexpr int kMostSteps = 4096;  // of periods and quarters; 1 s at 64 Hz takes 68
  for (int guard = 0; guard < kMostSteps && quarter < Motion::kParts; ++guard) {
    if (need) {
      Axes next{};
      for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t j = 0; j < 3 * m; ++j)
          next[a] += theta.X(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(a)) *
                     past[j / 3][j % 3];
        next[a] = std::clamp(next[a], -kDivergence[a], kDivergence[a]);
      }
      for (std::size_t j = m - 1; j > 0; --j) past[j] = past[j - 1];
      past[0] = next;
      from = to;
      to = next;
      step = 0;
      need = false;
    }
    const double end = static_cast<double>(quarter + 1) * part;
    const double go = std::min(period - step, end - t);
    const double f = (step + 0.5 * go) / period;
    for (std::size_t a = 0; a < 3; ++a)
      out.part[quarter][a] += go / part * (from[a] + f * (to[a] - from[a]));
    if (end - t <= period - step) {
      t = end;
      ++quarter;
      step += go;
    } else {
      t += go;
      need = true;
    }
  }
  // Beyond so many periods the last velocity goes on.
  for (; quarter < Motion::kParts; ++quarter) out.part[quarter] = to;
  return true;
}

}  // namespace tasks
