#include "tools/record/fusion_feed.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rt/clock/box_time.hpp"

namespace teletact {

FusionFeed::FusionFeed(tasks::FusionTask& task)
    : task_(task),
      frame_(std::make_unique<perception::RgbdFrame>()),
      patch_(std::make_unique<perception::SurfacePatch>()),
      cost_map_(std::make_unique<perception::CostMap>()) {}

const tasks::FusionTask::Out& FusionFeed::step(perception::SurfacePatch* window) noexcept {
  return run(true, window, cost_map_.get());
}

void FusionFeed::look(perception::SurfacePatch& window) noexcept {
  (void)run(false, &window, nullptr);
}

const tasks::FusionTask::Out& FusionFeed::run(bool fresh, perception::SurfacePatch* window,
                                              perception::CostMap* cost_map) noexcept {
  rt::Tick tick;
  tick.k = k_++;
  tick.release = tick.start = frame_->exposure;
  in.frame = frame_.get();
  in.frame_fresh = fresh;
  out_ = tasks::FusionTask::Out{};
  out_.patch = window;
  out_.cost_map = cost_map;
  const std::int64_t begin = rt::thread_cpu_ns();
  static_cast<void>(task_.step(tick, in, out_));
  cpu_ms_ = 1e-6 * static_cast<double>(rt::thread_cpu_ns() - begin);
  return out_;
}

double ClaimedError::add(const perception::Pose& X_WC, const perception::Pose& truth_WC) noexcept {
  if (count_++ == 0) X_TW_ = truth_WC * X_WC.inverse();
  const double off_m = ((X_TW_ * X_WC).translation() - truth_WC.translation()).norm();
  squares_m2_ += off_m * off_m;
  worst_m_ = std::max(worst_m_, off_m);
  return off_m;
}

double ClaimedError::ate_mm() const noexcept {
  return count_ > 0 ? 1e3 * std::sqrt(squares_m2_ / count_)
                    : std::numeric_limits<double>::quiet_NaN();
}

double ClaimedError::worst_mm() const noexcept {
  return count_ > 0 ? 1e3 * worst_m_ : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace teletact
