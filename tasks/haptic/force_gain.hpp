// Fade-in and ramps as one gain of the force, 0..1.
#pragma once

#include <algorithm>

namespace tasks {

class ForceGain {
 public:
  struct Tick {
    bool ramp_down = false;       // to zero; recovery climbs as a fade-in does
    bool touches = false;         // a hand that is enabled in contact fades in
    bool started_inside = false;  // contact was placed, not entered
    bool leaving = false;         // the hand is being let go
    double pace = 1;              // below 1, what climbs is slowed down
  };

  ForceGain() = default;
  ForceGain(double fade_in_s, double ramp_s) : fade_in_s_(fade_in_s), ramp_s_(ramp_s) {}

  [[nodiscard]] double value() const noexcept { return fade_ * ramp_; }
  [[nodiscard]] double ramp() const noexcept { return ramp_; }
  [[nodiscard]] bool enabled() const noexcept { return enabled_; }

  double advance(const Tick& t, double dt) noexcept {
    const double up = fade_in_s_ > 0 ? t.pace * dt / fade_in_s_ : 1.0;
    if (!enabled_) {
      enabled_ = true;
      fade_ = t.touches ? 0.0 : 1.0;
      ramp_ = t.ramp_down ? 0.0 : 1.0;
    }
    if (t.started_inside) fade_ = 0;
    if (t.leaving) {  // neither climbs meanwhile
      ramp_ = std::max(0.0, ramp_ - dt / kLeave_s);
      return value();
    }
    fade_ = std::min(1.0, fade_ + up);
    ramp_ = std::clamp(ramp_ + (t.ramp_down ? -dt / ramp_s_ : up), 0.0, 1.0);
    return value();
  }
  // The next contact fades in.
  void fade_in() noexcept { fade_ = 0; }
  // The hand was let go: no ramp holds what is touched next, and it fades in.
  void let_go() noexcept {
    ramp_ = 1;
    fade_ = 0;
  }
  // The next advance() decides where the gain begins.
  void disable() noexcept { enabled_ = false; }
  void off() noexcept {
    enabled_ = false;
    fade_ = ramp_ = 0;
  }

 private:
  // The hand is let go in this time.
  static constexpr double kLeave_s = 0.045;  // derived: less than 0.3 N a tick from 12 N

  double fade_in_s_ = 0, ramp_s_ = 1;
  double fade_ = 0, ramp_ = 0;
  bool enabled_ = false;
};

}  // namespace tasks
