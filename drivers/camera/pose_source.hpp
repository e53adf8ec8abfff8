// Where a synthetic camera is when it exposes. Implemented by what carries the camera: the virtual
// robot, or a fixed or scripted pose in tests.
#pragma once

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace drivers {

class PoseSource {
 public:
  virtual ~PoseSource() = default;
  // X_WC at instant t. Asked with rising t, at most a few frame periods in the past. A
  // ThreadedCamera asks up to half an exposure ahead, and from its own thread: then the
  // implementation must be safe against the thread that moves it.
  [[nodiscard]] virtual perception::Pose X_WC_at(rt::Time t) noexcept = 0;
};

class FixedPose : public PoseSource {
 public:
  explicit FixedPose(const perception::Pose& X_WC) : X_WC_(X_WC) {}
  [[nodiscard]] perception::Pose X_WC_at(rt::Time) noexcept override { return X_WC_; }

 private:
  perception::Pose X_WC_;
};

}  // namespace drivers
