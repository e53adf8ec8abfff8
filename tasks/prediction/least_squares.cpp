#include "tasks/prediction/least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tasks {

std::array<double, 2> ridge_solve(double a11, double a12, double a22, double b1, double b2,
                                  double lambda1, double lambda2) noexcept {
  const double m11 = a11 + lambda1, m22 = a22 + lambda2;
  // Cholesky of a positive definite 2x2: safer than Cramer's rule when it is nearly singular.
  const double l11 = std::sqrt(m11), l21 = a12 / l11;
  const double rest = m22 - l21 * l21;
  const double l22 = std::sqrt(std::max(rest, lambda2 * 1e-12));
  const double z1 = b1 / l11, z2 = (b2 - l21 * z1) / l22;
  const double x2 = z2 / l22;
  return {(z1 - l21 * x2) / l11, x2};
}

double ridge_condition(double a11, double a12, double a22, double lambda1,
                       double lambda2) noexcept {
  const double m11 = a11 + lambda1, m22 = a22 + lambda2;
  // Eigenvalues; the smaller one from the determinant, which does not cancel as their difference.
  const double half = 0.5 * (m11 + m22), large = half + std::hypot(0.5 * (m11 - m22), a12);
  const double small = (m11 * m22 - a12 * a12) / large;
  return small > 0 ? std::sqrt(large / small) : std::numeric_limits<double>::infinity();
}

LinearFit minimum_norm(const FitMatrix& A, const FitOutputs& B, double ridge) noexcept {
  const Eigen::Index n = A.rows(), m = A.cols(), all = ridge > 0 ? n + m : n;
  FitMatrix S(all, m);
  FitOutputs Y(all, 3);
  S.topRows(n) = A;
  Y.topRows(n) = B;
  if (ridge > 0) {
    S.bottomRows(m).setZero();
    S.bottomRows(m).diagonal().setConstant(std::sqrt(ridge));
    Y.bottomRows(m).setZero();
  }
  LinearFit fit;
  fit.X.setZero(m, 3);
  if (all == 0 || !(S.cwiseAbs().maxCoeff() > 0)) return fit;
  Eigen::CompleteOrthogonalDecomposition<FitMatrix> cod(all, m);
  cod.setThreshold(kRankShare);
  cod.compute(S);
  fit.rank = static_cast<int>(cod.rank());
  if (fit.rank == 0) return fit;
  fit.X = cod.solve(Y);
  fit.condition = std::abs(cod.matrixQTZ()(0, 0) / cod.matrixQTZ()(fit.rank - 1, fit.rank - 1));
  return fit;
}

}  // namespace tasks
