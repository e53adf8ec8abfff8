// Where a ground robot will be: from its last poses and velocities to its pose some time later.
//
// One interface, methods by name (motion_models.hpp says what each is):
//   none                it stays where it was last seen.
//   constant_velocity   its last velocity goes on (constant body twist, an exact arc); also `hold`.
//   paper               the published linear model over the last m velocities of all axes, as a
//                       least-norm fit.
//   ridge               the same with a ridge.
//   kalman              Kalman filter, constant acceleration.
//   singer              Kalman filter, acceleration that fades with 0.3 s.
//   lsq                 learned shares of the last changes of velocity; with commands known, their
//                       response.
//   own                 the models above weighted by how right each was of late (mixture.hpp); the
//                       default.
// Each states a covariance, of its own errors as they turned out (realised_error.hpp). Commands
// known ahead (on their way to the robot) count with `own` and `lsq`.
//
// Causal: predict() uses only what add() was given. Deterministic, allocation only in the
// constructor; everything else is noexcept. Frames: pose X_OB in a fixed frame, twist in the body
// frame. Times in seconds from any zero, strictly increasing.
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/planar.hpp"
#include "tasks/prediction/mixture.hpp"
#include "tasks/prediction/motion_history.hpp"
#include "tasks/prediction/motion_models.hpp"
#include "tasks/prediction/realised_error.hpp"

namespace tasks {

// Section [prediction.motion].
struct MotionPredictorConfig {
  std::string method = "own";
  // chosen on: not recorded; judged on: not recorded
  double window_s = 30.0;  // training instants no older than this
  double spacing_s = 0.1;  // between training instants
  double lag_1_s = 0.1, lag_2_s = 0.3;
  double prior_samples = 10;         // weight of "no change" against one instant
  double speed_scale_m_per_s = 0.2;  // an ordinary change of velocity
  double yaw_rate_scale_rad_per_s = 0.5;
  double acceleration_limit_m_per_s2 = 2.0;  // no correction beyond what this could do
  double yaw_acceleration_limit_rad_per_s2 = 6.0;
  double response_time_s = 0.2;  // prior of the response to commands

  int order = 3;              // no data: m of the published model
  int training_samples = 20;  // no data: its N
  double ridge = 0.02;        // no data: of `ridge`, m^2/s^2

  static const std::vector<std::string>& methods();
  void describe(config::Section& s);
};

class MotionPredictor {
 public:
  // Throws std::invalid_argument for an unknown method.
  explicit MotionPredictor(const MotionPredictorConfig& = {});

  // False and ignored: not finite, larger than 10^6, or not later than the last one.
  bool add(const MotionSample&) noexcept;
  // A command that holds from t on until the next one; may be known ahead of the samples. False and
  // ignored: as above.
  bool add_command(double t, const perception::Twist2& cmd_B) noexcept;

  // Of a change of speed: a share of the limit of acceleration, for so long.
  struct Belief {
    double share = 0.75, changes_s = 10;
  };

  struct Prediction {
    perception::Pose2 X_OB;
    perception::Twist2 mean_B;  // mean body twist over the horizon that leads there
    double horizon = 0;         // s after the newest sample
    double condition = 0;       // Motion::condition
    // Of x, y, yaw in the frame of the base at the newest sample.
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  };
  // The pose at `t`; at or before the newest sample: that sample's pose. False: no sample yet.
  // Remembers the horizon: later samples judge the method there.
  [[nodiscard]] bool predict(double t, Prediction& out) noexcept;
  // The same, and forgets that it was asked.
  [[nodiscard]] bool peek(double t, Prediction& out) const noexcept;
  // Pose at a past instant, between samples on the arc; false: outside what is held.
  [[nodiscard]] bool pose_at(double t, perception::Pose2& out) const noexcept {
    return history_.pose_at(t, out);
  }

  [[nodiscard]] std::size_t size() const noexcept { return history_.size(); }
  [[nodiscard]] const MotionSample& newest() const noexcept { return history_.newest(); }
  void clear() noexcept;

 private:
  void place(double h, Prediction& out) const noexcept;
  // No model's answer is farther from the newest velocity than the limits of acceleration let the
  // base get: a fit of badly conditioned data may say anything.
  void bound(double h, Motion& motion) const noexcept;

  MotionHistory history_;
  std::unique_ptr<MotionModel> model_, commanded_;  // commanded_: where `lsq` asks first
  Mixture* mixture_ = nullptr;
  bool bounded_ = true;  // `none` says by its name that nothing moves
  Belief belief_;
  Axes acceleration_limit_{};
  RealisedError error_;
  double asked_h_ = 0.15;
};

}  // namespace tasks
