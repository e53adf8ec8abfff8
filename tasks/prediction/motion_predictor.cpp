#include "tasks/prediction/motion_predictor.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tasks {
namespace {

using perception::Pose2;
using perception::Twist2;

std::array<double, 3> axes(const Twist2& v) noexcept { return {v.vx, v.vy, v.wz}; }
Twist2 twist(const std::array<double, 3>& a) noexcept { return {a[0], a[1], a[2]}; }

}  // namespace

std::array<double, 2> ridge_solve(double a11, double a12, double a22, double b1, double b2,
                                  double lambda1, double lambda2) noexcept {
  const double m11 = a11 + lambda1, m22 = a22 + lambda2;
  // Cholesky of a positive definite 2x2: safer than Cramer's rule when it is nearly singular.
  const double l11 = std::sqrt(m11), l21 = a12 / l11;
  const double rest = m22 - l21 * l21;
  const double l22 = std::sqrt(std::max(rest, lambda2 * 1e-12));
  const double z1 = b1 / l11, z2 = (b2 - l21 * z1) / l22;
  const double x2 = z2 / l22;
  return {(z1 - l21 * x2) / l11, x2};
}

MotionPredictor::MotionPredictor(const MotionPredictorConfig& config) : config_(config) {
  if (config.method == "none")
    method_ = Method::kNone;
  else if (config.method == "hold")
    method_ = Method::kHold;
  else if (config.method == "lsq")
    method_ = Method::kLsq;
  else
    throw std::invalid_argument("prediction method \"" + config.method +
                                "\" is not one of none, hold, lsq");
  entries_.resize(kEntries);
  commands_.resize(kCommands);
}

void MotionPredictor::clear() noexcept { head_ = size_ = command_head_ = command_size_ = 0; }

bool MotionPredictor::add(const MotionSample& s) noexcept {
  if (!std::isfinite(s.t) || !perception::is_finite(s.X_OB) || !perception::is_finite(s.v_B)) {
    return false;
  }
  if (size_ > 0 && !(s.t > newest().t)) return false;
  // A faster source is thinned: the newest sample is always kept, those behind it are spaced out.
  if (size_ >= 2 && s.t - at(size_ - 2).sample.t < kMinSpacing) --size_;
  if (size_ == kEntries) {
    head_ = (head_ + 1) % kEntries;
    --size_;
  }
  Entry e;
  e.sample = s;
  if (size_ > 0) {
    const Entry& last = at(size_ - 1);
    const Axes a = axes(last.sample.v_B), b = axes(s.v_B);
    for (std::size_t k = 0; k < 3; ++k) {
      e.travelled[k] = last.travelled[k] + 0.5 * (a[k] + b[k]) * (s.t - last.sample.t);
    }
  }
  entries_[(head_ + size_) % kEntries] = e;
  ++size_;
  return true;
}

bool MotionPredictor::add_command(double t, const Twist2& cmd_B) noexcept {
  if (!std::isfinite(t) || !perception::is_finite(cmd_B)) return false;
  if (command_size_ > 0 && !(t > commands_[(command_head_ + command_size_ - 1) % kCommands].t)) {
    return false;
  }
  if (command_size_ == kCommands) {
    command_head_ = (command_head_ + 1) % kCommands;
    --command_size_;
  }
  commands_[(command_head_ + command_size_) % kCommands] = {t, axes(cmd_B)};
  ++command_size_;
  return true;
}

// Index of the last entry not after t; 0 when all are after it.
std::size_t MotionPredictor::last_not_after(double t) const noexcept {
  std::size_t lo = 0, hi = size_;
  while (hi - lo > 1) {
    const std::size_t mid = lo + (hi - lo) / 2;
    (at(mid).sample.t <= t ? lo : hi) = mid;
  }
  return lo;
}

MotionPredictor::Axes MotionPredictor::velocity(double t, std::size_t& hint) const noexcept {
  while (hint > 0 && at(hint).sample.t > t) --hint;
  const Entry& a = at(hint);
  Axes v = axes(a.sample.v_B);
  if (hint + 1 >= size_) return v;
  const Entry& b = at(hint + 1);
  const double f = (t - a.sample.t) / (b.sample.t - a.sample.t);
  const Axes w = axes(b.sample.v_B);
  for (std::size_t k = 0; k < 3; ++k) v[k] += f * (w[k] - v[k]);
  return v;
}

MotionPredictor::Axes MotionPredictor::travelled(double t, std::size_t& hint) const noexcept {
  const Axes v = velocity(t, hint);
  const Entry& a = at(hint);
  const Axes u = axes(a.sample.v_B);
  Axes out = a.travelled;
  for (std::size_t k = 0; k < 3; ++k) out[k] += 0.5 * (u[k] + v[k]) * (t - a.sample.t);
  return out;
}

// Mean velocity over the next h seconds, learned from what came after the changes seen so far.
MotionPredictor::Axes MotionPredictor::learned_mean(double h) const noexcept {
  const MotionSample& now = newest();
  const double first = at(0).sample.t;
  std::size_t i_end = size_ - 1, i_q = size_ - 1, i_1 = size_ - 1, i_2 = size_ - 1;
  struct Sums {
    double a11 = 0, a12 = 0, a22 = 0, b1 = 0, b2 = 0;
  };
  std::array<Sums, 3> sums{};
  const int most = static_cast<int>(config_.window_s / config_.spacing_s);
  const double back = std::max(config_.lag_1_s, config_.lag_2_s);
  for (int n = 0; n < most; ++n) {
    const double q = now.t - h - n * config_.spacing_s;
    if (q < now.t - config_.window_s || q - back < first) break;
    const Axes end = travelled(q + h, i_end), start = travelled(q, i_q);
    const Axes v = velocity(q, i_q), v1 = velocity(q - config_.lag_1_s, i_1),
               v2 = velocity(q - config_.lag_2_s, i_2);
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
  Axes mean = axes(now.v_B);
  if (now.t - back < first) return mean;
  i_1 = i_2 = size_ - 1;
  const Axes v1 = velocity(now.t - config_.lag_1_s, i_1);
  const Axes v2 = velocity(now.t - config_.lag_2_s, i_2);
  for (std::size_t k = 0; k < 3; ++k) {
    const bool turn = k == 2;
    const double scale = turn ? config_.yaw_rate_scale_rad_per_s : config_.speed_scale_m_per_s;
    const double bound =
        0.5 * h *
        (turn ? config_.yaw_acceleration_limit_rad_per_s2 : config_.acceleration_limit_m_per_s2);
    const double lambda = config_.prior_samples * scale * scale;
    const Sums& s = sums[k];
    const auto theta = ridge_solve(s.a11, s.a12, s.a22, s.b1, s.b2, lambda, lambda);
    const double change = theta[0] * (mean[k] - v1[k]) + theta[1] * (mean[k] - v2[k]);
    mean[k] += std::clamp(change, -bound, bound);
  }
  return mean;
}

const MotionPredictor::Command* MotionPredictor::command_at(double t) const noexcept {
  std::size_t lo = 0, hi = command_size_;
  while (lo < hi) {  // first command after t
    const std::size_t mid = lo + (hi - lo) / 2;
    if (commands_[(command_head_ + mid) % kCommands].t <= t)
      lo = mid + 1;
    else
      hi = mid;
  }
  return lo == 0 ? nullptr : &commands_[(command_head_ + lo - 1) % kCommands];
}

// The velocity follows the known commands as it has followed them so far.
bool MotionPredictor::respond(double t, Prediction& out) const noexcept {
  const MotionSample& now = newest();
  if (command_size_ == 0 || command_at(now.t) == nullptr) return false;
  const double prior = 1.0 / config_.response_time_s;
  std::array<std::array<double, 5>, 3> sums{};
  for (std::size_t i = size_ - 1; i > 0; --i) {
    const MotionSample& a = at(i - 1).sample;
    const MotionSample& b = at(i).sample;
    if (now.t - a.t > config_.window_s) break;
    const Command* c = command_at(a.t);
    if (c == nullptr) break;
    const double dt = b.t - a.t;
    if (dt > 0.5) continue;  // a gap says nothing about the response
    const Axes va = axes(a.v_B), vb = axes(b.v_B);
    for (std::size_t k = 0; k < 3; ++k) {
      const double x1 = dt * c->value[k], x2 = -0.5 * dt * (va[k] + vb[k]);
      const double y = vb[k] - va[k] - prior * (x1 + x2);
      auto& s = sums[k];
      s[0] += x1 * x1;
      s[1] += x1 * x2;
      s[2] += x2 * x2;
      s[3] += x1 * y;
      s[4] += x2 * y;
    }
  }
  Axes gain{}, rate{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double scale = config_.spacing_s *
                         (k == 2 ? config_.yaw_rate_scale_rad_per_s : config_.speed_scale_m_per_s);
    const double lambda = config_.prior_samples * scale * scale;
    const auto& s = sums[k];
    const auto p = ridge_solve(s[0], s[1], s[2], s[3], s[4], lambda, lambda);
    rate[k] = std::clamp(prior + p[1], 0.2, 100.0);
    gain[k] = std::clamp((prior + p[0]) / rate[k], 0.0, 2.0);
  }
  Axes v = axes(now.v_B), total{};
  Pose2 X = now.X_OB;
  constexpr double kStep = 0.01;
  const int steps = std::max(1, static_cast<int>(std::ceil(std::min(t - now.t, 30.0) / kStep)));
  const double dt = (t - now.t) / steps;
  for (int n = 0; n < steps; ++n) {
    const Command* c = command_at(now.t + (n + 0.5) * dt);
    Axes mean{};
    for (std::size_t k = 0; k < 3; ++k) {
      const double settled = gain[k] * c->value[k];
      const double decay = std::exp(-rate[k] * dt);
      const double next = settled + (v[k] - settled) * decay;
      mean[k] = settled + (v[k] - settled) * (1.0 - decay) / (rate[k] * dt);
      total[k] += mean[k] * dt;
      v[k] = next;
    }
    X = perception::integrate(X, twist(mean), dt);
  }
  out.X_OB = X;
  const double h = t - now.t;
  out.mean_B = {total[0] / h, total[1] / h, total[2] / h};
  out.horizon = h;
  return true;
}

bool MotionPredictor::predict(double t, Prediction& out) const noexcept {
  if (size_ == 0) return false;
  const MotionSample& now = newest();
  const double h = t - now.t;
  out.X_OB = now.X_OB;
  out.mean_B = {};
  out.horizon = 0;
  if (!(h > 0) || !std::isfinite(h)) return true;
  out.horizon = h;
  if (method_ == Method::kNone) return true;
  if (method_ == Method::kLsq && respond(t, out)) return true;
  out.mean_B = method_ == Method::kLsq ? twist(learned_mean(h)) : now.v_B;
  out.X_OB = perception::integrate(now.X_OB, out.mean_B, h);
  return true;
}

bool MotionPredictor::pose_at(double t, Pose2& out) const noexcept {
  if (size_ == 0 || !(t >= at(0).sample.t) || t > newest().t) return false;
  const std::size_t i = last_not_after(t);
  const MotionSample& a = at(i).sample;
  if (i + 1 >= size_ || t == a.t) {
    out = a.X_OB;
    return true;
  }
  // Between two poses: along the arc that joins them.
  const MotionSample& b = at(i + 1).sample;
  const double f = (t - a.t) / (b.t - a.t);
  const Pose2 d = perception::compose(perception::inverse(a.X_OB), b.X_OB);
  const double half = 0.5 * d.yaw;
  const double k = std::abs(half) < 1e-6 ? 1.0 : half / std::tan(half);
  const Twist2 log{k * d.x + half * d.y, -half * d.x + k * d.y, d.yaw};
  out = perception::compose(a.X_OB, perception::exp_se2({f * log.vx, f * log.vy, f * log.wz}));
  return true;
}

}  // namespace tasks
