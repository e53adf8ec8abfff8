// A surface that leaves the hand, or comes at it faster than a hand can be carried: the last
// contact's plane is kept, and fades. If the surface falls away, the blend removes its force. If it
// comes too fast or becomes unknown, the force fades out.
// Frame: W (= map).  SI.  Nothing here allocates, locks or throws.
#pragma once

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/proxy.hpp"
#include "tasks/haptic/spring.hpp"
#include "tasks/haptic/surface_blend.hpp"

namespace tasks {

class SurfaceLeft {
 public:
  // The hand as a blend begins.
  struct Held {
    const perception::Vec3& hand_W;
    const perception::Vec3& rendered_W;
    double most_m;     // a surface that goes or comes farther in this blend does not carry the hand
    double deepest_m;  // of the plane that is kept: where the force limit begins
  };
  // A surface that goes or comes faster than this over one period does not carry a hand: 8 mm at
  // 30 Hz. A step of 5 mm does.
  static constexpr double kLeaves_m_per_s = 0.24;

  // What the blend that begins brings to a hand that stands. Returned: how much higher the newer
  // window has the surface under the proxy, m. The blend's begin() has to follow.
  [[nodiscard]] double look_ahead_m(SurfaceBlend& blend, const ProxyState& proxy,
                                    const Held& held) noexcept;

  // The hand is being let go.
  [[nodiscard]] bool leaving() const noexcept { return leaving_; }
  // While it is: the last contact's plane, which pushes as far as the hand is behind it.
  [[nodiscard]] Spring spring(const perception::Vec3& p_WH) const noexcept;
  void end() noexcept { leaving_ = false; }
  // True once for each surface that left: it is to be told to the operator.
  [[nodiscard]] bool take_told() noexcept {
    const bool told = left_;
    left_ = false;
    return told;
  }

 private:
  bool leaving_ = false, left_ = false;  // left_: to be told in this tick
  perception::Vec3 p_W_ = perception::Vec3::Zero(), n_W_ = perception::Vec3::Zero();
};

}  // namespace tasks
