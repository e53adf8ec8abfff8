// Where odometry alone has the camera. It is carried on by odometry's steps, and follows the
// claimed poses no faster than odometry may err. A thing that creeps by less than a frame can tell
// (MotionWatch) takes the camera away from it by millimetres that add up; the chain keeps the sum.
//
// Noexcept, no allocation.
#pragma once

#include "perception/geometry/pose.hpp"

namespace tasks {

using perception::Pose;

class OdometryChain {
 public:
  // chosen on: moving 51 (3, 22), moving 7 (6), moving 53 (5), recording backwards; judged on: moving 606, moving 707
  // What a resting camera's tracked pose may go in a frame, map and noise together: an eighth of
  // the 4 mm by which two poses are told apart. The rotation is the same way at 1 m.
  static constexpr double kFreeWay_m = 0.0005, kFreeTurn_deg = 0.03;
  // Farther from the claims: odometry has slipped or lies, or the image has shown otherwise for
  // long. Starts anew.
  static constexpr double kGivenUp_m = 0.02, kGivenUp_deg = 1.2;

  void restart(const Pose& X_WC) noexcept {
    X_WC_ = X_WC;
    slack_m_ = slack_deg_ = 0;
  }
  // By a step of the camera and its stated error.
  void carry(const Pose& step_C, double error_m, double error_deg) noexcept;
  // A claimed pose.
  void follow(const Pose& X_WC) noexcept;
  [[nodiscard]] const Pose& X_WC() const noexcept { return X_WC_; }

 private:
  Pose X_WC_ = Pose::Identity();
  double slack_m_ = 0, slack_deg_ = 0;  // since the last claim
};

}  // namespace tasks
