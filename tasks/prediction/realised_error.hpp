// The covariance that a predictor states: of its own errors, as they turned out.
//
// Each new sample keeps where the predictor puts the base at the horizon last asked for; when the
// samples reach that instant, the error (x, y, yaw in the frame of the base at the sample it was
// made from) goes into a fading mean of its square. Before that, and weighing as much as
// `kPriorTime_s`, stands a prior. Another horizon: an error grows as its square.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstddef>

#include "tasks/prediction/motion_history.hpp"

namespace tasks {

class RealisedError {
 public:
  using Matrix3 = Eigen::Matrix3d;
  static constexpr double kMemory_s = 10, kPriorTime_s = 1;

  // A new sample, and where the predictor puts the base `h` seconds after it.
  void add(const MotionHistory&, double h, const perception::Pose2& predicted_X_OB) noexcept;
  void clear() noexcept;
  [[nodiscard]] Matrix3 covariance(double h) const noexcept;

 private:
  struct Pending {
    double t = 0, h = 0;
    perception::Pose2 X_OB, predicted_X_OB;
  };
  static constexpr std::size_t kPending = 128;
  std::array<Pending, kPending> pending_{};
  std::size_t head_ = 0, size_ = 0;
  // Of the error over h^2; `weight_` in seconds.
  Matrix3 sum_ = Matrix3::Zero();
  double weight_ = 0, settled_t_ = 0;
};

}  // namespace tasks
