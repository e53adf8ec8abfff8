// Linear least squares of the predictors: small, of fixed size, and with an answer for every finite
// input.
//
//   ridge_solve        two unknowns by the normal equations, closed form.
//   minimum_norm       many unknowns and outputs, rank-revealing: a complete orthogonal
//                      decomposition of [A; sqrt(ridge) I]. Of a rank-deficient system without
//                      ridge it is the solution of least norm.
//   RecursiveQr        the triangle of the QR decomposition, kept row by row (Givens rotations)
//                      with exponential forgetting: no sum of squares is ever formed, so the
//                      condition number is not squared. Kept in extended precision: after 10^6
//                      rows it still agrees with a batch QR (tests/unit/tasks_prediction).
// All noexcept, no allocation. Source: Golub, Van Loan, Matrix Computations, 5.4 and 6.5.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace tasks {

// min |A x - b|^2 + x^T diag(lambda) x for two unknowns, given the sums of the normal equations
// {a11, a12, a22} = A^T A and {b1, b2} = A^T b. Finite for finite input and lambda > 0.
[[nodiscard]] std::array<double, 2> ridge_solve(double a11, double a12, double a22, double b1,
                                                double b2, double lambda1, double lambda2) noexcept;

// Of the matrix that was solved there, A over sqrt(lambda): largest over smallest singular value.
[[nodiscard]] double ridge_condition(double a11, double a12, double a22, double lambda1,
                                     double lambda2) noexcept;

// Of at most 64 rows (data and ridge together), 18 unknowns, 3 outputs.
using FitMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 64, 18>;
using FitOutputs = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 64, 3>;
struct LinearFit {
  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 18, 3> X;  // zero where the rank is
  int rank = 0;
  double condition = 0;  // largest over smallest pivot that counts for the rank; 0: rank 0
};
// A pivot counts for the rank above this share of the largest.
inline constexpr double kRankShare = 1e-10;
// min |A X - B|^2 + ridge |X|^2; of least norm where that leaves a choice.
[[nodiscard]] LinearFit minimum_norm(const FitMatrix& A, const FitOutputs& B,
                                     double ridge) noexcept;

// min sum_i w_i (a_i . x - b_i)^2 with w_i = forget^(2 rows since). `Unknowns` + 1 columns of the
// triangle.
template <std::size_t Unknowns>
class RecursiveQr {
 public:
  // `prior`: rows prior * e_k . x = 0 that are never forgotten.
  explicit RecursiveQr(double prior = 0) noexcept : prior_(prior) { clear(); }
  void clear() noexcept {
    for (auto& row : R_) row.fill(0);
    rows_ = 0;
  }
  // `keep` in (0, 1]: factor of all earlier rows. A row that is not finite is ignored.
  void add(std::array<double, Unknowns> a, double b, double keep) noexcept {
    std::array<Real, kColumns> row{};
    for (std::size_t k = 0; k < kUnknowns; ++k) {
      if (!std::isfinite(a[k])) return;
      row[k] = static_cast<Real>(a[k]);
    }
    if (!std::isfinite(b)) return;
    row[kUnknowns] = static_cast<Real>(b);
    for (auto& r : R_)
      for (Real& v : r) v *= static_cast<Real>(keep);
    rotate(R_, row);
    ++rows_;
  }
  // The solution with the prior; finite always. A direction that neither rows nor prior say
  // anything about is 0.
  [[nodiscard]] std::array<double, Unknowns> solve() const noexcept {
    Triangle R = with_prior();
    std::array<Real, kUnknowns> x{};
    const Real least = largest(R) * static_cast<Real>(1e-15);
    for (std::size_t i = kUnknowns; i-- > 0;) {
      Real s = R[i][kUnknowns];
      for (std::size_t k = i + 1; k < kUnknowns; ++k) s -= R[i][k] * x[k];
      x[i] = std::abs(R[i][i]) > least ? s / R[i][i] : static_cast<Real>(0);
    }
    std::array<double, Unknowns> out{};
    for (std::size_t k = 0; k < kUnknowns; ++k) out[k] = static_cast<double>(x[k]);
    return out;
  }
  // Of the triangle with its prior: largest over smallest diagonal entry, a lower bound of the
  // condition number. Infinite: singular.
  [[nodiscard]] double condition() const noexcept {
    const Triangle R = with_prior();
    Real least = std::abs(R[0][0]);
    for (std::size_t k = 1; k < kUnknowns; ++k) least = std::min(least, std::abs(R[k][k]));
    return static_cast<double>(largest(R) / least);
  }
  [[nodiscard]] std::size_t rows() const noexcept { return rows_; }

 private:
  using Real = long double;
  static constexpr std::size_t kUnknowns = Unknowns, kColumns = Unknowns + 1;
  using Triangle = std::array<std::array<Real, kColumns>, kUnknowns>;

  static void rotate(Triangle& R, std::array<Real, kColumns>& row) noexcept {
    for (std::size_t k = 0; k < kUnknowns; ++k) {
      if (row[k] == 0) continue;
      const Real h = std::hypot(R[k][k], row[k]), c = R[k][k] / h, s = row[k] / h;
      for (std::size_t j = k; j < kColumns; ++j) {
        const Real a = R[k][j], b = row[j];
        R[k][j] = c * a + s * b;
        row[j] = c * b - s * a;
      }
    }
  }
  [[nodiscard]] Triangle with_prior() const noexcept {
    Triangle R = R_;
    for (std::size_t k = 0; k < kUnknowns && prior_ > 0; ++k) {
      std::array<Real, kColumns> row{};
      row[k] = static_cast<Real>(prior_);
      rotate(R, row);
    }
    return R;
  }
  [[nodiscard]] static Real largest(const Triangle& R) noexcept {
    Real m = 0;
    for (std::size_t k = 0; k < kUnknowns; ++k) m = std::max(m, std::abs(R[k][k]));
    return m;
  }

  double prior_;
  Triangle R_{};
  std::size_t rows_ = 0;
};

}  // namespace tasks
