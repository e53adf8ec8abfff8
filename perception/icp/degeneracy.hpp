// Which of the six directions of motion does the scene constrain?
//
// The 6x6 matrix is scaled: rotation columns are divided by a length L (weighted mean depth), and
// all by the sum of weights. So an eigenvalue is the mean squared response of a residual to a unit
// motion of the scene points. A flat wall has three near 0: two slides and the spin about its
// normal. On the plain sums
// J_m J_m^T the noise of the normals adds sigma_n^2 to each, so a noisy wall looks constrained; on
// the cross moment of live and model normals independent noise averages out. A direction counts as
// constrained when its cross eigenvalue is at least min_information of the largest.
#pragma once

#include <array>
#include <cmath>

#include <Eigen/Core>

#include "config/schema.hpp"

namespace perception {

struct DegeneracyConfig {
  // chosen on: turn at 54 deg/s past a nearly bare wall; judged on: not recorded
  double min_information =
      3e-4;  // of the largest eigenvalue: one over the condition number allowed
  void describe(config::Section& s);
};

struct Degeneracy {
  Eigen::Matrix<double, 6, 6> constrained;  // columns 0..constrained_count-1, scaled twists
  Eigen::Matrix<double, 6, 6> degenerate;   // columns 0..degenerate_count-1
  Eigen::Matrix<double, 6, 1> eigenvalues;  // of the scaled cross moment, rising
  int constrained_count = 0, degenerate_count = 6;
  double condition = 0;  // of the scaled plain sums; infinity when singular
};

// H: plain sums, cross: cross moment, both unscaled; weight: sum of weights; length in m.
[[nodiscard]] Degeneracy analyse(const Eigen::Matrix<double, 6, 6>& H,
                                 const Eigen::Matrix<double, 6, 6>& cross, double weight,
                                 double length_m, const DegeneracyConfig& config) noexcept;

// The step of H xi = -g confined to the constrained directions; unscaled twist. False when the
// reduced system is not positive definite or not finite: xi is then 0.
[[nodiscard]] bool confined_step(const Eigen::Matrix<double, 6, 6>& H,
                                 const Eigen::Matrix<double, 6, 1>& g, double length_m,
                                 const Degeneracy& d, Eigen::Matrix<double, 6, 1>& xi) noexcept;

}  // namespace perception
