#include "perception/icp/degeneracy.hpp"

#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace perception {

using Mat6 = Eigen::Matrix<double, 6, 6>;
using Vec6 = Eigen::Matrix<double, 6, 1>;

void DegeneracyConfig::describe(config::Section& s) {
  s.number("min_information", min_information, 1e-8, 0.5,
           "smallest eigenvalue that constrains, as a share of the largest");
}

namespace {

Vec6 scale(double length_m) noexcept {
  Vec6 d;
  d << 1, 1, 1, 1 / length_m, 1 / length_m, 1 / length_m;
  return d;
}

}  // namespace

Degeneracy analyse(const Mat6& H, const Mat6& cross, double weight, double length_m,
                   const DegeneracyConfig& config) noexcept {
  Degeneracy d;
  d.constrained.setZero();
  d.degenerate.setIdentity();
  d.eigenvalues.setZero();
  d.condition = std::numeric_limits<double>::infinity();
  if (!(weight > 0) || !(length_m > 0) || !H.allFinite() || !cross.allFinite()) return d;

  const Vec6 s = scale(length_m);
  Eigen::SelfAdjointEigenSolver<Mat6> plain(s.asDiagonal() * (H / weight) * s.asDiagonal(),
                                            Eigen::EigenvaluesOnly);
  const double smallest = plain.eigenvalues()(0), largest = plain.eigenvalues()(5);
  if (smallest > 0) d.condition = largest / smallest;

  const Eigen::SelfAdjointEigenSolver<Mat6> solver(s.asDiagonal() * (cross / weight) *
                                                   s.asDiagonal());
  d.eigenvalues = solver.eigenvalues();
  const double limit = config.min_information * d.eigenvalues(5);
  d.degenerate_count = 0;
  for (int i = 0; i < 6; ++i) {
    const bool seen = d.eigenvalues(i) >= limit && d.eigenvalues(i) > 0;
    if (seen)
      d.constrained.col(d.constrained_count++) = solver.eigenvectors().col(i);
    else
      d.degenerate.col(d.degenerate_count++) = solver.eigenvectors().col(i);
  }
  return d;
}

bool confined_step(const Mat6& H, const Vec6& g, double length_m, const Degeneracy& d,
                   Vec6& xi) noexcept {
  xi.setZero();
  if (d.constrained_count == 0) return true;
  const Vec6 s = scale(length_m);
  // Reduced system in the basis of constrained directions; unused rows are an identity.
  const Mat6 U = d.constrained;
  Mat6 A = U.transpose() * (s.asDiagonal() * H * s.asDiagonal()) * U;
  Vec6 b = -(U.transpose() * (s.asDiagonal() * g));
  for (int i = d.constrained_count; i < 6; ++i) {
    A.row(i).setZero();
    A.col(i).setZero();
    A(i, i) = 1;
    b(i) = 0;
  }
  const Eigen::LDLT<Mat6> ldlt(A);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  const Vec6 step = s.asDiagonal() * (U * ldlt.solve(b));
  if (!step.allFinite()) return false;
  xi = step;
  return true;
}

}  // namespace perception
