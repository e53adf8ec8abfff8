// Where a ground robot will be: from its last poses and velocities to its pose some time later.
//
// Methods
//   none   it stays where it was last seen.
//   hold   its last velocity goes on (constant body twist, an exact arc).
//   lsq    regularised linear least squares over the last velocities. Per axis of the body twist,
//   the
//          mean velocity over the horizon h is the last velocity plus a learned share of its
//          changes:
//
//            m(t, h) = v(t) + theta_1 (v(t) - v(t - lag_1)) + theta_2 (v(t) - v(t - lag_2))
//            theta   = (Phi^T Phi + Lambda)^-1 Phi^T y,   y(q) = m(q, h) observed - v(q)
//
//          over the training instants q of the last `window_s` whose outcome is already known
//          (q + h <= t). Lambda is worth `prior_samples` instants of ordinary motion, so without
//          data, or with data that say nothing (rest, constant speed), theta -> 0 and lsq is hold.
//          The inverse is the one the published formula lacks; the 2x2 system is solved in closed
//          form. With commands known ahead (cmd columns of a log) the velocity instead follows the
//          command by a first-order response dv/dt = p1 cmd - p2 v, (p1, p2) by the same
//          regularised fit, and is integrated forward under the known commands.
//
// Causal: predict() uses only what add() was given. Deterministic, allocation only in the
// constructor. Frames: pose X_OB in a fixed frame, twist in the body frame. Times in seconds from
// any zero, strictly increasing.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/planar.hpp"

namespace tasks {

// Section [prediction.motion].
struct MotionPredictorConfig {
  std::string method = "lsq";
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

  void describe(config::Section& s) {
    s.text("method", method, {"none", "hold", "lsq"}, "how the velocity goes on");
    s.number("window_s", window_s, 0.5, 30, "length of the training data");
    s.number("spacing_s", spacing_s, 0.02, 1, "between training instants");
    s.number("lag_1_s", lag_1_s, 0.02, 1, "first velocity difference");
    s.number("lag_2_s", lag_2_s, 0.02, 2, "second velocity difference");
    s.number("prior_samples", prior_samples, 0.01, 1e6, "weight of the prior");
    s.number("speed_scale_m_per_s", speed_scale_m_per_s, 0.001, 10, "ordinary change of speed");
    s.number("yaw_rate_scale_rad_per_s", yaw_rate_scale_rad_per_s, 0.001, 10,
             "ordinary change of turn rate");
    s.number("acceleration_limit_m_per_s2", acceleration_limit_m_per_s2, 0.01, 100,
             "bound of the learned correction");
    s.number("yaw_acceleration_limit_rad_per_s2", yaw_acceleration_limit_rad_per_s2, 0.01, 100,
             "bound of the learned correction");
    s.number("response_time_s", response_time_s, 0.01, 5, "prior response to a command");
  }
};

struct MotionSample {
  double t = 0;  // s
  perception::Pose2 X_OB;
  perception::Twist2 v_B;
};

// min |A x - b|^2 + x^T diag(lambda) x for two unknowns, given the sums of the normal equations
// {a11, a12, a22} = A^T A and {b1, b2} = A^T b. Finite for finite input and lambda > 0.
[[nodiscard]] std::array<double, 2> ridge_solve(double a11, double a12, double a22, double b1,
                                                double b2, double lambda1, double lambda2) noexcept;

class MotionPredictor {
 public:
  // Throws std::invalid_argument for an unknown method.
  explicit MotionPredictor(const MotionPredictorConfig& = {});

  // False and ignored: not finite, or not later than the last one.
  bool add(const MotionSample&) noexcept;
  // A command that holds from t on until the next one; may be known ahead of the samples. False and
  // ignored: not finite, or not later than the last one.
  bool add_command(double t, const perception::Twist2& cmd_B) noexcept;

  struct Prediction {
    perception::Pose2 X_OB;
    perception::Twist2 mean_B;  // mean body twist over the horizon that leads there
    double horizon = 0;         // s after the newest sample
  };
  // The pose at `t`; at or before the newest sample: that sample's pose. False: no sample yet.
  [[nodiscard]] bool predict(double t, Prediction& out) const noexcept;
  // Pose at a past instant, between samples on the arc; false: outside what is held.
  [[nodiscard]] bool pose_at(double t, perception::Pose2& out) const noexcept;

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] const MotionSample& newest() const noexcept { return at(size_ - 1).sample; }
  void clear() noexcept;

 private:
  enum class Method : std::uint8_t { kNone, kHold, kLsq };
  using Axes = std::array<double, 3>;
  struct Entry {
    MotionSample sample;
    Axes travelled{};  // integral of v since the first sample (trapezoids)
  };
  struct Command {
    double t = 0;
    Axes value{};
  };
  static constexpr std::size_t kEntries = 2048, kCommands = 4096;
  static constexpr double kMinSpacing = 0.0155;  // samples nearer than this replace the last one

  [[nodiscard]] const Entry& at(std::size_t i) const noexcept {
    return entries_[(head_ + i) % kEntries];
  }
  [[nodiscard]] std::size_t last_not_after(double t) const noexcept;
  [[nodiscard]] Axes velocity(double t, std::size_t& hint) const noexcept;
  [[nodiscard]] Axes travelled(double t, std::size_t& hint) const noexcept;
  [[nodiscard]] const Command* command_at(double t) const noexcept;
  [[nodiscard]] Axes learned_mean(double h) const noexcept;
  [[nodiscard]] bool respond(double t, Prediction& out) const noexcept;

  MotionPredictorConfig config_;
  Method method_ = Method::kLsq;
  std::vector<Entry> entries_;
  std::vector<Command> commands_;
  std::size_t head_ = 0, size_ = 0, command_head_ = 0, command_size_ = 0;
};

}  // namespace tasks
