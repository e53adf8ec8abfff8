// A surface that leaves the hand, or comes at it faster than a hand can be carried: the last
// contact's plane is kept, and fades. If the surface falls away, the blend removes its force. If it
// comes too fast or becomes unknown, the force fades out. Noise goes to and fro and is no such
// motion: what counts is a way beyond the noise of the windows before.
// Frame: W (= map).  SI.  Nothing here allocates, locks or throws.
#pragma once

#include <array>
#include <cstddef>

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/proxy.hpp"
#include "tasks/haptic/spring.hpp"
#include "tasks/haptic/surface_blend.hpp"

namespace tasks {

// The rises of a face from window to window, m, newest last, and what of them is a motion.
class FaceMotion {
 public:
  // A rise of the face in the window that begins.
  void take(double rise_m) noexcept;
  // The way that the face has gone in its last windows, 1 to kMostWindows of them: positive up. 0:
  // none of these is more than most_m a window, and beyond the noise of the rises before them.
  [[nodiscard]] double way_m(double most_m) const noexcept;
  void forget() noexcept { count_ = 0; }

 private:
  static constexpr std::size_t kKept = 16, kMostWindows = 4;
  [[nodiscard]] double noise_m(std::size_t without) const noexcept;
  std::array<double, kKept> rises_m_{};  // ring
  std::size_t count_ = 0;                // ever taken
};

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

  // By how much the newer window has the whole face about the proxy higher, m, by the last
  // look_ahead_m(): noise of single nodes is not in it. 0: that is not known.
  [[nodiscard]] double face_rise_m() const noexcept { return face_rise_m_; }

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
  FaceMotion motion_;
  double face_rise_m_ = 0;
  bool leaving_ = false, left_ = false;  // left_: to be told in this tick
  perception::Vec3 p_W_ = perception::Vec3::Zero(), n_W_ = perception::Vec3::Zero();
};

}  // namespace tasks
