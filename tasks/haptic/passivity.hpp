// Passivity controller of the haptic loop (time-domain passivity: Hannaford and Ryu 2002). It works on what the
// observer counts (energy.hpp), and keeps E + booked above -1 mJ whatever the hand does, in two parts:
//
//   damping  F -= alpha v,  alpha = min(debt / (v^2 T), K T): pays back what is missing. K T/2 pays for the leak of the
//            hold in the mean, twice that pays old debts. v is the slope of the longest window of positions that a
//            straight line explains to one encoder step (adaptive windowing: Janabi-Sharifi, Hayward, Chen 2000),
//            late by half that window, at most 4 ms. So an encoder that rattles between two steps has no
//            velocity: damping by the last step alone would feed it, since the next one goes back.
//   bound    the force stands until the next sample, so what it can give away by then is known beforehand:
//            |F| reach, reach = how far the hand can get along F. It may not be more than what is available,
//            E + booked, and a margin. This is what ends a rattle: damping pays for motion, not for single steps, each
//            of which costs K quantum^2 / 2.
//
// Frames: D haptic base.  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "perception/geometry/pose.hpp"

namespace tasks {

// Velocity from positions one period apart.
class VelocityWindow {
 public:
  VelocityWindow() = default;
  VelocityWindow(double quantum_m, double period_s)
      : tolerance_m_(1.001 * quantum_m),
        period_s_(period_s),
        longest_(std::clamp<std::size_t>(static_cast<std::size_t>(0.008 / period_s), 1, kMost)) {}

  void forget() noexcept { size_ = 0; }
  void see(const perception::Vec3& p) noexcept {
    newest_ = (newest_ + 1) % p_.size();
    p_[newest_] = p;
    size_ = std::min(size_ + 1, p_.size());
  }
  // m/s; zero before the second position.
  [[nodiscard]] perception::Vec3 velocity() const noexcept {
    perception::Vec3 step = perception::Vec3::Zero();
    for (std::size_t n = 1; n < size_ && n <= longest_; ++n) {
      const perception::Vec3 slope = (at(0) - at(n)) / static_cast<double>(n);
      if (!straight(n, slope)) break;
      step = slope;
    }
    return step / period_s_;
  }

 private:
  static constexpr std::size_t kMost = 16;
  [[nodiscard]] const perception::Vec3& at(std::size_t ago) const noexcept {
    return p_[(newest_ + p_.size() - ago) % p_.size()];
  }
  [[nodiscard]] bool straight(std::size_t n, const perception::Vec3& slope) const noexcept {
    for (std::size_t i = 1; i < n; ++i) {
      const perception::Vec3 off = at(i) - (at(0) - static_cast<double>(i) * slope);
      if (off.cwiseAbs().maxCoeff() > tolerance_m_) return false;
    }
    return true;
  }
  double tolerance_m_ = 0, period_s_ = 1e-3;
  std::size_t longest_ = 1, newest_ = 0, size_ = 0;
  std::array<perception::Vec3, kMost + 1> p_{};
};

class PassivityController {
 public:
  PassivityController() = default;
  // Of the device: mass and encoder step.
  PassivityController(double mass_kg, double quantum_m, double period_s)
      : window_(quantum_m, period_s), mass_kg_(mass_kg), quantum_m_(quantum_m) {}

  void forget() noexcept { window_.forget(); }
  void see(const perception::Vec3& p_DH) noexcept { window_.see(p_DH); }

  // The force that may be sent instead of `f_D`, before guards. dx_D: motion since the last sample; reserve_J: what
  // was dissipated beyond what was created, this tick's spring counted in; spring_J: what the spring holds now.
  [[nodiscard]] perception::Vec3 limited(const perception::Vec3& f_D, const perception::Vec3& dx_D,
                                         double reserve_J, double spring_J, double stiffness,
                                         double dt) const noexcept {
    perception::Vec3 f = f_D;
    if (reserve_J < 0) {
      const perception::Vec3 v = window_.velocity();
      const double v2 = v.squaredNorm();
      if (v2 > 1e-12) f -= std::min(-reserve_J / (v2 * dt), stiffness * dt) * v;
    }
    const double size = f.norm();
    if (!(size > 0)) return f;
    const double reach =
        dx_D.dot(f) / size + kSteps * quantum_m_ + (size + kHand_N) / mass_kg_ * dt * dt;
    const double most = std::max(reserve_J + spring_J + kMargin_J, 0.0);
    return size * reach > most ? perception::Vec3(f * (most / (size * reach))) : f;
  }

 private:
  // E + booked may go this far below zero. The rest up to 1 mJ is for the slew guard, which comes after and may let
  // the force fall more slowly.
  static constexpr double kMargin_J = 0.4e-3;
  // Steps of the encoder counted as reach at rest. Two would do for the tick to come; with more the force goes down
  // over several ticks as the energy runs out, instead of in one.
  static constexpr double kSteps = 8;
  static constexpr double kHand_N = 5;  // what the hand itself may add along F

  VelocityWindow window_;
  double mass_kg_ = 0.2, quantum_m_ = 0;
};

}  // namespace tasks
