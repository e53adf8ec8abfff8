// Energy observer of the haptic loop (E(k) = E(k-1) - F(k-1) . (x(k) - x(k-1)), the
// force on the hand times its motion, exact for a force held between ticks). E is the net energy
// the hand put in: passive means E >= 0. What a moving surface or a changing stiffness puts into
// the spring at a held hand is booked apart. The device's own damping b dissipates what the loop
// may make: 0.8 b v^2 T a tick is credited. E + booked + credit is what passivity is asserted on.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "perception/geometry/pose.hpp"

namespace tasks {

class EnergyObserver {
 public:
  // Motion of the hand under the force sent last tick.
  void move(const perception::Vec3& f_sent_D, const perception::Vec3& dx_D) noexcept {
    const double e = -f_sent_D.dot(dx_D);
    energy_J_ += e;
    reserve_J_ += e;
  }
  // Dissipated by the device since the last tick.
  void credit(double paid_J) noexcept {
    credit_J_ += paid_J;
    reserve_J_ += paid_J;
  }
  // Energy put into the spring from outside, and the change of what the spring holds; dt advances
  // the window of the power limit.
  void book(double injected_J, double spring_change_J, double dt) noexcept {
    booked_J_ += injected_J;
    reserve_J_ = std::min(reserve_J_ + injected_J - spring_change_J, kReserveCap_J);
    const double in = std::max(injected_J, 0.0);
    event_J_ += in;
    most_J_ = std::max(most_J_, in);
    bins_[bin_] += in;
    bin_time_ += dt;
    if (bin_time_ >= kBin_s) {
      bin_time_ = 0;
      bin_ = (bin_ + 1) % bins_.size();
      bins_[bin_] = 0;
    }
  }
  void begin_event() noexcept { event_J_ = most_J_ = 0; }
  // One more tick like the worst of this event would book more than 1 W over 100 ms, or 50 mJ in
  // the event: whoever injects has to slow down.
  [[nodiscard]] bool over_budget() const noexcept {
    double sum = most_J_;
    for (const double b : bins_) sum += b;
    return sum > 0.1 || event_J_ + most_J_ > 0.05;
  }
  [[nodiscard]] double energy_J() const noexcept { return energy_J_; }
  [[nodiscard]] double booked_J() const noexcept { return booked_J_; }
  [[nodiscard]] double credit_J() const noexcept { return credit_J_; }
  // What was dissipated beyond what was created, at most 20 mJ: what the passivity controller may
  // still let go. Energy held by the spring is not part of it: that is the hand's to take back.
  [[nodiscard]] double reserve_J() const noexcept { return reserve_J_; }

 private:
  static constexpr double kBin_s = 0.01;
  static constexpr double kReserveCap_J = 0.02;
  double energy_J_ = 0, booked_J_ = 0, credit_J_ = 0, reserve_J_ = 0, event_J_ = 0, most_J_ = 0,
         bin_time_ = 0;
  std::array<double, 11> bins_{};  // the one that fills up and 100 ms behind it
  std::size_t bin_ = 0;
};

}  // namespace tasks
