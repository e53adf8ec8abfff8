// From a prediction to the next one without a jump: what a display or an act follows.
//
// When a new measurement moves the predicted pose, the difference to what was last shown stays as
// an offset, and fades with `time_s`. So what is shown is continuous in place and heading; with no
// further jumps it is the prediction after a few `time_s`. An offset larger than the limits is no
// correction but another place: it is taken at once, and counted.
#pragma once

#include <cmath>
#include <cstdint>

#include "perception/geometry/planar.hpp"

namespace tasks {

class HandBack {
 public:
  struct Config {
    double time_s = 0.1;
    double limit_m = 0.3, limit_rad = 0.6;
  };
  explicit HandBack(const Config& config) noexcept : config_(config) {}

  // `before`: where the prediction made from the older measurement puts the base at `t`; `after`:
  // that from the new one.
  void take(double t, const perception::Pose2& before, const perception::Pose2& after) noexcept {
    const perception::Pose2 was = show(t, before);
    x_ = was.x - after.x;
    y_ = was.y - after.y;
    yaw_ = perception::wrap_angle(was.yaw - after.yaw);
    t_ = t;
    if (!(std::hypot(x_, y_) <= config_.limit_m && std::abs(yaw_) <= config_.limit_rad)) {
      x_ = y_ = yaw_ = 0;
      ++jumps_;
    }
  }
  // What to show at `t`, not before the last take(): the newest prediction and what is left of the
  // offset.
  [[nodiscard]] perception::Pose2 show(double t,
                                       const perception::Pose2& predicted) const noexcept {
    const double left = t > t_ ? std::exp(-(t - t_) / config_.time_s) : 1.0;
    return {predicted.x + left * x_, predicted.y + left * y_,
            perception::wrap_angle(predicted.yaw + left * yaw_)};
  }
  [[nodiscard]] std::uint64_t jumps() const noexcept { return jumps_; }
  void clear() noexcept { x_ = y_ = yaw_ = 0; }

 private:
  Config config_;
  double x_ = 0, y_ = 0, yaw_ = 0, t_ = 0;
  std::uint64_t jumps_ = 0;
};

}  // namespace tasks
