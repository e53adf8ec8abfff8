// The device as a body: the twin's mass, damping, dry friction, encoder steps and delay, with or
// without a hand that holds it. Frame S of a solid (tools/measure/support/haptic_solids.hpp), SI.
#pragma once

#include <cmath>
#include <functional>

#include "tools/measure/stability/cases.hpp"

namespace stability {

inline constexpr double kPeriod = 1e-3;

struct Body {
  double mass = 0.2, damping = 2, coulomb = 0;
  int delay = 0;  // ticks from position to force
};
struct Grip {  // a hand: its mass on the device, a spring and a damper to where it wants to be
  double mass = 0, damping = 0, stiffness = 0;
};

// The device and the hand as one mass, S.
class Twin {
 public:
  using Vec3 = rig::Vec3;

  Twin(const Body& body, const Grip& grip, const Vec3& x) : body_(body), grip_(grip), x_(x) {}
  [[nodiscard]] Vec3 reading() const {
    return {1e-5 * std::round(x_.x() / 1e-5), 1e-5 * std::round(x_.y() / 1e-5),
            1e-5 * std::round(x_.z() / 1e-5)};
  }
  [[nodiscard]] const Vec3& position() const { return x_; }
  [[nodiscard]] const Vec3& velocity() const { return v_; }
  // At rest under `f`, which the last tick has sent already; then a kick.
  void settled(const Vec3& f, const Vec3& v) {
    f_last_ = f;
    v_ = v;
  }
  // One period under the force of this tick's reading, a push, and the grip's goal, which moves.
  void advance(const Vec3& f_now, const Vec3& push, const Vec3& goal, const Vec3& goal_v) {
    const Vec3 f = body_.delay > 0 ? f_last_ : f_now;
    f_last_ = f_now;
    const double mass = body_.mass + grip_.mass;
    constexpr int kPieces = 50;  // 20 us: far below every time constant here, none under 10 ms
    constexpr double kPiece = kPeriod / kPieces;
    for (int i = 0; i < kPieces; ++i) {
      const Vec3 to = goal + (kPiece * i) * goal_v;
      const Vec3 pull = f + push + grip_.stiffness * (to - x_) + grip_.damping * (goal_v - v_);
      const Vec3 v = (mass * v_ + kPiece * pull) / (mass + kPiece * body_.damping);
      const double dry = kPiece * body_.coulomb / mass, speed = v.norm();
      v_ = speed > dry ? Vec3(v * (1 - dry / speed)) : Vec3::Zero();
      x_ += kPiece * v_;
    }
  }

 private:
  Body body_;
  Grip grip_;
  Vec3 x_, v_ = Vec3::Zero(), f_last_ = Vec3::Zero();
};

// The solid's samples under a spring of this stiffness, on this device.
[[nodiscard]] rig::Scene held(const Setting& s, std::function<double(const rig::Vec3&)> solid,
                              const Body& body, double stiffness);

}  // namespace stability
