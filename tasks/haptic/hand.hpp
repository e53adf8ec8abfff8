// The hand as the last samples have it.  Frame: D haptic base.  SI.
#pragma once

#include <algorithm>

#include "perception/geometry/pose.hpp"
#include "rt/clock/tick.hpp"

namespace tasks {

class Hand {
 public:
  // There is a last sample to go on from; there was ever one.
  [[nodiscard]] bool known() const noexcept { return known_; }
  [[nodiscard]] bool seen() const noexcept { return seen_; }
  [[nodiscard]] const perception::Vec3& p_D() const noexcept { return p_D_; }
  // From positions, with 10 ms of delay.
  [[nodiscard]] const perception::Vec3& v_D() const noexcept { return v_D_; }
  [[nodiscard]] rt::Time time() const noexcept { return time_; }

  // A sample of a position that is a number, `dt` after the last one. Returns the motion since
  // then; zero where there is nothing to go on from.
  perception::Vec3 take(const perception::Vec3& p_D, rt::Time release, double dt) noexcept {
    perception::Vec3 dx_D = perception::Vec3::Zero();
    if (known_) {
      dx_D = p_D - p_D_;
      v_D_ += (dx_D / dt - v_D_) * std::min(1.0, dt / kVelocityTime_s);
    } else {
      v_D_ = perception::Vec3::Zero();
    }
    known_ = seen_ = true;
    p_D_ = p_D;
    time_ = release;
    return dx_D;
  }
  // The next sample is not to be connected with the last one.
  void forget() noexcept { known_ = false; }

 private:
  static constexpr double kVelocityTime_s = 0.01;
  bool known_ = false, seen_ = false;
  perception::Vec3 p_D_ = perception::Vec3::Zero(), v_D_ = perception::Vec3::Zero();
  rt::Time time_{};
};

}  // namespace tasks
