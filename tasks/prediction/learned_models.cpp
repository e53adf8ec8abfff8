// The models that learn shares: LearnedShare, CommandResponse.
#include <algorithm>
#include <cmath>

#include "tasks/prediction/motion_models.hpp"

namespace tasks {

// chosen on: prediction 5, first halves of the logs; judged on: prediction 4, second halves
// (docs/measured/prediction.md)
constexpr double kDiffers = 0.1;  // by this share of its scale command and velocity differ in an
                                  // instant of the prior: a rate shows only while they do

bool LearnedShare::predict(const MotionHistory& history, double h, Motion& out) const noexcept {
  const MotionSample& now = history.newest();
  const double first = history.first_t();
  const std::size_t last = history.size() - 1;
  std::size_t i_end = last, i_q = last, i_1 = last, i_2 = last;
  struct Sums {
    double a11 = 0, a12 = 0, a22 = 0, b1 = 0, b2 = 0;
  };
  std::array<Sums, 3> sums{};
  const int most = static_cast<int>(config_.window_s / config_.spacing_s);
  const double back = std::max(config_.lag_1_s, config_.lag_2_s);
  for (int n = 0; n < most; ++n) {
    const double q = now.t - h - n * config_.spacing_s;
    if (q < now.t - config_.window_s || q - back < first) break;
    const Axes end = history.travelled(q + h, i_end), start = history.travelled(q, i_q);
    const Axes v = history.velocity(q, i_q), v1 = history.velocity(q - config_.lag_1_s, i_1),
               v2 = history.velocity(q - config_.lag_2_s, i_2);
    for (std::size_t k = 0; k < 3; ++k) {
      const double x1 = v[k] - v1[k], x2 = v[k] - v2[k];
      const double y = (end[k] - start[k]) / h - v[k];
      Sums& s = sums[k];
      s.a11 += x1 * x1;
      s.a12 += x1 * x2;
      s.a22 += x2 * x2;
      s.b1 += x1 * y;
      s.b2 += x2 * y;
    }
  }
  const Axes v = axes(now.v_B);
  Axes mean = v;
  double condition = 0;
  if (now.t - back >= first) {
    i_1 = i_2 = last;
    const Axes v1 = history.velocity(now.t - config_.lag_1_s, i_1);
    const Axes v2 = history.velocity(now.t - config_.lag_2_s, i_2);
    for (std::size_t k = 0; k < 3; ++k) {
      const double bound = 0.5 * h * config_.acceleration_limit[k];
      const double lambda = config_.prior_samples * config_.scale[k] * config_.scale[k];
      const Sums& s = sums[k];
      const auto theta = ridge_solve(s.a11, s.a12, s.a22, s.b1, s.b2, lambda, lambda);
      condition = std::max(condition, ridge_condition(s.a11, s.a12, s.a22, lambda, lambda));
      const double change = theta[0] * (v[k] - v1[k]) + theta[1] * (v[k] - v2[k]);
      mean[k] += std::clamp(change, -bound, bound);
    }
  }
  out = Motion::ramp(v, mean);
  out.condition = condition;
  return true;
}

CommandResponse::CommandResponse(const Config& config) noexcept : config_(config) {
  for (std::size_t k = 0; k < 3; ++k) {
    const double scale = kDiffers * config.spacing_s * config.scale[k];
    fit_[k] = RecursiveQr<2>(std::sqrt(config.prior_samples) * scale);
  }
}

void CommandResponse::clear() noexcept {
  for (auto& f : fit_) f.clear();
  have_last_ = false;
}

// What the last step says about the response, as a difference from the prior's.
void CommandResponse::add(const MotionHistory& history) noexcept {
  const MotionSample& b = history.newest();
  if (have_last_ && b.t - last_.t < MotionHistory::kMinSpacing_s) return;
  const MotionSample a = last_;
  const bool first = !have_last_;
  last_ = b;
  have_last_ = true;
  const double dt = b.t - a.t;
  if (first || dt > 0.5) return;  // a gap says nothing about the response
  Axes told{};                    // integral of the command
  constexpr int kSteps = 10;
  for (int i = 0; i < kSteps; ++i) {
    const Axes* c = history.command_at(a.t + (i + 0.5) / kSteps * dt);
    if (c == nullptr) return;
    for (std::size_t k = 0; k < 3; ++k) told[k] += dt / kSteps * (*c)[k];
  }
  const double prior = 1.0 / config_.response_time_s, keep = std::exp(-0.5 * dt / config_.window_s);
  const Axes va = axes(a.v_B), vb = axes(b.v_B);
  // Integral of the velocity: from pose to pose, which has no noise of its own.
  const Axes gone = axes(way_between(a.X_OB, b.X_OB));
  for (std::size_t k = 0; k < 3; ++k) {
    const double x1 = told[k], x2 = -gone[k];
    fit_[k].add({x1, x2}, vb[k] - va[k] - prior * (x1 + x2), keep);
  }
}

bool CommandResponse::predict(const MotionHistory& history, double h, Motion& out) const noexcept {
  const MotionSample& now = history.newest();
  if (history.command_at(now.t) == nullptr) return false;
  const double prior = 1.0 / config_.response_time_s;
  Axes gain{}, rate{};
  out.condition = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto p = fit_[k].solve();
    out.condition = std::max(out.condition, fit_[k].condition());
    rate[k] = std::clamp(prior + p[1], 0.2, 100.0);
    gain[k] = std::clamp((prior + p[0]) / rate[k], 0.0, 2.0);
  }
  Axes v = axes(now.v_B);
  constexpr double kStep_s = 0.01;
  const double part = h / static_cast<double>(Motion::kParts);
  const int steps = std::max(1, static_cast<int>(std::ceil(std::min(part, 10.0) / kStep_s)));
  const double dt = part / steps;
  double t = now.t;
  for (Axes& mean : out.part) {
    mean = {};
    for (int n = 0; n < steps; ++n, t += dt) {
      const Axes& c = *history.command_at(t + 0.5 * dt);
      for (std::size_t k = 0; k < 3; ++k) {
        const double settled = gain[k] * c[k], decay = std::exp(-rate[k] * dt);
        mean[k] += (settled + (v[k] - settled) * (1.0 - decay) / (rate[k] * dt)) / steps;
        v[k] = settled + (v[k] - settled) * decay;
      }
    }
  }
  return true;
}

}  // namespace tasks
