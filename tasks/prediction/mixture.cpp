#include "tasks/prediction/mixture.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tasks {

Mixture::Mixture(const Config& config, std::vector<Member> members)
    : config_(config), members_(std::move(members)) {
  members_.resize(std::min(members_.size(), kMost));
  clear();
}

void Mixture::clear() noexcept {
  for (std::size_t i = 0; i < members_.size(); ++i) {
    members_[i].model->clear();
    for (std::size_t k = 0; k < 3; ++k) error_[i][k] = members_[i].prior_error * config_.floor[k];
  }
  pending_head_ = pending_size_ = 0;
  settled_ = false;
  said_h_ = 0;
}

void Mixture::judge_at(double h) noexcept { horizon_s_ = std::clamp(h, 0.01, 2.0); }

void Mixture::settle(const MotionHistory& history) noexcept {
  while (pending_size_ > 0) {
    const Pending& p = pending_[pending_head_];
    perception::Pose2 X;
    if (p.t + p.h > history.newest().t) return;
    pending_head_ = (pending_head_ + 1) % kPending;
    --pending_size_;
    if (!history.pose_at(p.t + p.h, X)) continue;
    const double since = settled_ ? std::clamp(p.t - settled_t_, 0.0, 1.0) : 0.1;
    settled_ = true;
    settled_t_ = p.t;
    const double fade = std::exp(-since / config_.memory_s);
    // The constant twist that leads from where it was to where it is.
    const Axes way = axes(way_between(p.X_OB, X));
    const Axes truth{way[0] / p.h, way[1] / p.h, way[2] / p.h};
    for (std::size_t i = 0; i < members_.size(); ++i) {
      if (!p.known[i]) continue;
      for (std::size_t k = 0; k < 3; ++k)
        error_[i][k] = fade * error_[i][k] + (1 - fade) * std::abs(p.mean[i][k] - truth[k]);
    }
  }
}

void Mixture::add(const MotionHistory& history) noexcept {
  for (const Member& m : members_) m.model->add(history);
  said_h_ = 0;
  settle(history);
  const MotionSample& now = history.newest();
  if (pending_size_ > 0) {
    const Pending& last = pending_[(pending_head_ + pending_size_ - 1) % kPending];
    if (now.t - last.t < std::max(MotionHistory::kMinSpacing_s, horizon_s_ / 32)) return;
  }
  if (pending_size_ == kPending) {
    pending_head_ = (pending_head_ + 1) % kPending;
    --pending_size_;
  }
  Pending& p = pending_[(pending_head_ + pending_size_++) % kPending];
  p.t = now.t;
  p.h = horizon_s_;
  p.X_OB = now.X_OB;
  for (std::size_t i = 0; i < members_.size(); ++i) {
    Said& said = said_[i];
    said.known = members_[i].model->predict(history, horizon_s_, said.motion);
    p.known[i] = said.known;
    p.mean[i] = said.motion.mean();
  }
  said_h_ = horizon_s_;
}

bool Mixture::predict(const MotionHistory& history, double h, Motion& out) const noexcept {
  out = {};
  Axes total{};
  for (std::size_t i = 0; i < members_.size(); ++i) {
    Said said;
    if (h == said_h_)
      said = said_[i];
    else
      said.known = members_[i].model->predict(history, h, said.motion);
    if (!said.known) continue;
    out.condition = std::max(out.condition, said.motion.condition);
    for (std::size_t k = 0; k < 3; ++k) {
      const double e = members_[i].counts * error_[i][k] / config_.floor[k];
      const double w = std::pow(e + 1, -config_.sharpness);
      total[k] += w;
      for (std::size_t q = 0; q < Motion::kParts; ++q) out.part[q][k] += w * said.motion.part[q][k];
    }
  }
  const Axes v = axes(history.newest().v_B);
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t q = 0; q < Motion::kParts; ++q) {
      const double f = (2.0 * static_cast<double>(q) + 1.0) / static_cast<double>(Motion::kParts);
      const double bound = 0.5 * h * f * config_.acceleration_limit[k];
      const double mean = total[k] > 0 ? out.part[q][k] / total[k] : v[k];
      out.part[q][k] = v[k] + std::clamp(mean - v[k], -bound, bound);
    }
  }
  return true;
}

}  // namespace tasks
