// Predictors on a trace, as a box would run them: at the true instant of every row, told only the
// rows that were taken at least the delay before (to 1 us) and their stamps, each is asked where
// the base is now.
//
// Error: distance in the plane between the predicted and the true motion since the newest row it
// was told. So what odometry had drifted before counts for nobody, and slip and lag during the
// delay count.
#pragma once

#include <string>
#include <vector>

#include "tasks/prediction/motion_predictor.hpp"
#include "tools/measure/prediction/motion_trace.hpp"

namespace teletact {

struct JudgedMethod {
  std::string method;  // as in metric names
  tasks::MotionPredictorConfig config;
  bool commands = false;  // told those that act before the target
};

struct MotionErrors {
  std::string method;
  std::vector<double> t_s, error_m;  // a target each
  std::vector<double> condition;     // of what was solved for it; 0: nothing was
  double cpu_us = 0;                 // of the thread: a target, with the rows that came before it

  // NaN when there are none. p95 at the nearest rank.
  [[nodiscard]] double mean_cm() const;
  [[nodiscard]] double p95_cm() const;
  [[nodiscard]] double max_cm() const;
  [[nodiscard]] double condition_p50() const;
};

[[nodiscard]] MotionErrors judge(const MotionTrace&, const JudgedMethod&);
// The predicted poses alone, for the check of causality: a target each.
[[nodiscard]] std::vector<perception::Pose2> predicted_poses(const MotionTrace&,
                                                             const JudgedMethod&);
// How many predictions made up to the middle of the trace change when all rows and commands after
// what they may know are replaced by others. 0: no look-ahead.
[[nodiscard]] int changed_by_the_future(const MotionTrace&, const JudgedMethod&);

// What one errs who knows how the wheels will turn, and not how they slip: no predictor that is
// told encoders and commands alone goes below it, but by luck. Where MotionTrace::wheels is known.
[[nodiscard]] MotionErrors wheels_known(const MotionTrace&);

// Of each target the smallest error of all: what choosing a method anew at each instant, with the
// truth known, could reach.
[[nodiscard]] MotionErrors best_of_each_instant(const std::vector<MotionErrors>&);

}  // namespace teletact
