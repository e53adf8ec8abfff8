// How the base's velocity goes on: one model a method, behind one interface. All are causal,
// noexcept and allocate nothing after construction; MotionPredictor (motion_predictor.hpp)
// integrates what they say into a pose.
//
//   ConstantVelocity    the last velocity.
//   AccelerationFilter  Kalman filter of velocity and acceleration, an axis at a time. The
//                       acceleration is a random walk (`kalman`), or fades with `time_s` (Singer's
//                       model, IEEE AES 6(4), 1970: `singer`).
//   LinearModel         the published one: v(k + 1) = Theta^T [v(k); v(k - 1); .. v(k - m + 1)] of
//                       all axes at once, Theta from the last N such rows by least squares,
//                       iterated a sample at a time to the horizon. Printed: Theta = Phi^T Y with
//                       no inverse; here (Phi^T Phi + ridge I)^-1 Phi^T Y, of least norm for ridge
//                       0. It may diverge: velocities are cut at +-5 m/s and +-20 rad/s, which no
//                       base of ours reaches.
//   LearnedShare        `lsq`: the last velocity and learned shares of its two last changes
//                       (below).
//   CommandResponse     the velocity follows known commands with a fitted first-order response.
#pragma once

#include <array>
#include <cstddef>

#include "tasks/prediction/least_squares.hpp"
#include "tasks/prediction/motion_history.hpp"

namespace tasks {

// Mean body velocity in each quarter of the horizon.
struct Motion {
  static constexpr std::size_t kParts = 4;
  std::array<Axes, kParts> part{};
  // Of the least squares behind it, the worst of its axes and members (least_squares.hpp); 0: none
  // was solved. Infinite: singular.
  double condition = 0;

  [[nodiscard]] Axes mean() const noexcept;
  // A velocity that goes from `start` on a line so that its mean is `mean`.
  [[nodiscard]] static Motion ramp(const Axes& start, const Axes& mean) noexcept;
};

class MotionModel {
 public:
  MotionModel() = default;
  virtual ~MotionModel() = default;
  MotionModel(const MotionModel&) = delete;
  MotionModel& operator=(const MotionModel&) = delete;

  // The newest sample of the history is new.
  virtual void add(const MotionHistory&) noexcept {}
  virtual void clear() noexcept {}
  // From the newest sample for h > 0 seconds; false: it knows nothing. At least one sample is
  // there.
  [[nodiscard]] virtual bool predict(const MotionHistory&, double h,
                                     Motion& out) const noexcept = 0;
};

class StandStill final : public MotionModel {
 public:
  [[nodiscard]] bool predict(const MotionHistory&, double, Motion& out) const noexcept override {
    out = {};
    return true;
  }
};

class ConstantVelocity final : public MotionModel {
 public:
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;
};

class AccelerationFilter final : public MotionModel {
 public:
  struct Config {
    double time_s = 0;  // of the acceleration; 0: it does not fade
    // Spectral density of the jerk, and standard deviation of a measured velocity: of vx and vy, of
    // wz.
    std::array<double, 3> jerk{};
    std::array<double, 3> noise{};
  };
  explicit AccelerationFilter(const Config& config) noexcept : config_(config) {}
  void add(const MotionHistory&) noexcept override;
  void clear() noexcept override { started_ = false; }
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;

 private:
  struct Axis {
    double v = 0, a = 0, pvv = 0, pva = 0, paa = 0;
  };
  void start(const MotionSample&) noexcept;
  Config config_;
  std::array<Axis, 3> axis_{};
  double t_ = 0;
  bool started_ = false;
};

class LinearModel final : public MotionModel {
 public:
  static constexpr std::size_t kLargestOrder = 6, kMostRows = 40;
  static constexpr Axes kDivergence{5, 5, 20};
  struct Config {
    std::size_t order = 3, rows = 20;  // m and N
    double ridge = 0;
  };
  explicit LinearModel(const Config&) noexcept;
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;
  // The fit on what is held: rows 3 j .. 3 j + 2 are of v(k - j).
  [[nodiscard]] LinearFit fit(const MotionHistory&) const noexcept;

 private:
  Config config_;
};

// Per axis, the mean velocity over the horizon h is the last velocity plus a learned share of its
// changes:
//
//   m(t, h) = v(t) + theta_1 (v(t) - v(t - lag_1)) + theta_2 (v(t) - v(t - lag_2))
//   theta   = (Phi^T Phi + Lambda)^-1 Phi^T y,   y(q) = m(q, h) observed - v(q)
//
// over the training instants q of the last `window_s` whose outcome is already known (q + h <= t).
// Lambda is worth `prior_samples` instants of ordinary motion, so without data, or with data that
// say nothing (rest, constant speed), theta -> 0 and it is ConstantVelocity. The 2x2 system is
// solved in closed form; the correction is bounded.
class LearnedShare final : public MotionModel {
 public:
  struct Config {
    double window_s = 30, spacing_s = 0.1, lag_1_s = 0.1, lag_2_s = 0.3, prior_samples = 10;
    Axes scale{}, acceleration_limit{};
  };
  explicit LearnedShare(const Config& config) noexcept : config_(config) {}
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;

 private:
  Config config_;
};

// dv/dt = p1 cmd - p2 v per axis; (p1, p2) by recursive least squares with forgetting and a prior.
// Knows nothing without a command that is in force at the newest sample.
class CommandResponse final : public MotionModel {
 public:
  struct Config {
    double response_time_s = 0.2, window_s = 30;
    double prior_samples = 10, spacing_s = 0.1;
    Axes scale{};
  };
  explicit CommandResponse(const Config&) noexcept;
  void add(const MotionHistory&) noexcept override;
  void clear() noexcept override;
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;

 private:
  Config config_;
  std::array<RecursiveQr<2>, 3> fit_;
  MotionSample last_;
  bool have_last_ = false;
};

}  // namespace tasks
