// The least squares of the predictors against slow references: singular values, and Gram-Schmidt
// over all rows at once.
#include "tasks/prediction/least_squares.hpp"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using tasks::FitMatrix;
using tasks::FitOutputs;
using tasks::LinearFit;
using tasks::RecursiveQr;

// A^+ B with every singular value below 1e-9 of the largest left out: the answer of least norm.
Eigen::MatrixXd by_singular_values(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::VectorXd s = svd.singularValues();
  for (double& v : s) v = v > 1e-9 * svd.singularValues()[0] ? 1 / v : 0;
  return svd.matrixV() * s.asDiagonal() * svd.matrixU().transpose() * B;
}

TEST(MinimumNorm, EqualsThePseudoInverseAtEveryRank) {
  const std::uint64_t seed = 411;
  rt::Random random(seed);
  for (int i = 0; i < 300; ++i) {
    const auto n = static_cast<int>(random.integer(1, 40)),
               m = static_cast<int>(random.integer(1, 6)) * 3;
    const auto rank = static_cast<int>(random.integer(1, std::min(n, m)));
    Eigen::MatrixXd L(n, rank), R(rank, m), B(n, 3);
    for (double& v : L.reshaped()) v = random.normal();
    for (double& v : R.reshaped()) v = random.normal();
    for (double& v : B.reshaped()) v = random.normal();
    const Eigen::MatrixXd A = L * R;
    const LinearFit fit = [&] {
      const FitMatrix a = A;
      const FitOutputs b = B;
      rt::Section section;  // no allocation
      return tasks::minimum_norm(a, b, 0);
    }();
    EXPECT_EQ(fit.rank, rank) << "seed " << seed << " case " << i;
    const Eigen::MatrixXd want = by_singular_values(A, B);
    const Eigen::VectorXd s = A.jacobiSvd().singularValues();
    const double condition = s[0] / s[rank - 1];
    ASSERT_LE((fit.X - want).norm(), 1e-13 * condition * condition * (1 + want.norm()))
        << "seed " << seed << " case " << i;
    // The pivots' ratio is within a factor of the dimension of the true condition.
    EXPECT_LE(fit.condition, 1.01 * condition * m);
    EXPECT_GE(fit.condition, condition / (20 * m)) << "seed " << seed << " case " << i;
  }
}

TEST(MinimumNorm, RidgeEqualsTheNormalEquations) {
  const std::uint64_t seed = 412;
  rt::Random random(seed);
  for (int i = 0; i < 100; ++i) {
    const int n = 20, m = 9;
    FitMatrix A(n, m);
    FitOutputs B(n, 3);
    for (double& v : A.reshaped()) v = random.normal();
    for (double& v : B.reshaped()) v = random.normal();
    const double ridge = std::pow(10, random.uniform(-3, 1));
    Eigen::MatrixXd N = A.transpose() * A;
    N.diagonal().array() += ridge;
    const Eigen::MatrixXd want = N.inverse() * (A.transpose() * B);
    const LinearFit fit = tasks::minimum_norm(A, B, ridge);
    ASSERT_LE((fit.X - want).norm(), 1e-9 * (1 + want.norm())) << "seed " << seed;
  }
}

TEST(MinimumNorm, NothingAndZerosAreAnsweredByZero) {
  const LinearFit none = tasks::minimum_norm(FitMatrix(0, 9), FitOutputs(0, 3), 0);
  EXPECT_EQ(none.rank, 0);
  EXPECT_EQ(none.X.rows(), 9);
  EXPECT_EQ(none.X.norm(), 0);
  const LinearFit zeros = tasks::minimum_norm(FitMatrix::Zero(20, 9), FitOutputs::Ones(20, 3), 0);
  EXPECT_EQ(zeros.rank, 0);
  EXPECT_EQ(zeros.X.norm(), 0);
  EXPECT_EQ(zeros.condition, 0);
}

constexpr std::size_t kUnknowns = 4;
using Row = std::array<double, kUnknowns + 1>;

// All rows at once, by modified Gram-Schmidt on [A b] in extended precision.
std::array<long double, kUnknowns> batch(const std::vector<Row>& rows, double keep) {
  std::vector<std::array<long double, kUnknowns + 1>> Q(rows.size());
  long double w = 1;
  for (std::size_t i = rows.size(); i-- > 0; w *= static_cast<long double>(keep))
    for (std::size_t k = 0; k <= kUnknowns; ++k) Q[i][k] = w * static_cast<long double>(rows[i][k]);
  long double R[kUnknowns][kUnknowns + 1] = {};
  for (std::size_t k = 0; k < kUnknowns; ++k) {
    long double norm = 0;
    for (const auto& q : Q) norm += q[k] * q[k];
    R[k][k] = std::sqrt(norm);
    for (auto& q : Q) q[k] /= R[k][k];
    for (std::size_t j = k + 1; j <= kUnknowns; ++j) {
      for (const auto& q : Q) R[k][j] += q[k] * q[j];
      for (auto& q : Q) q[j] -= R[k][j] * q[k];
    }
  }
  std::array<long double, kUnknowns> x{};
  for (std::size_t i = kUnknowns; i-- > 0;) {
    x[i] = R[i][kUnknowns];
    for (std::size_t k = i + 1; k < kUnknowns; ++k) x[i] -= R[i][k] * x[k];
    x[i] /= R[i][i];
  }
  return x;
}

// Rows whose last column differs from the first by `apart`: the condition is about 2 / apart.
std::vector<Row> nearly_collinear(std::uint64_t seed, std::size_t count, double apart) {
  rt::Random random(seed);
  std::vector<Row> rows(count);
  for (Row& r : rows) {
    for (std::size_t k = 0; k + 1 < kUnknowns; ++k) r[k] = random.normal();
    r[kUnknowns - 1] = r[0] + apart * random.normal();
    r[kUnknowns] = r[0] - 2 * r[1] + 0.5 * r[2] + 3 * r[kUnknowns - 1] + 0.01 * random.normal();
  }
  return rows;
}

TEST(RecursiveQr, AMillionUpdatesAgreeWithABatchQr) {
  constexpr std::size_t kRows = 1'000'000;
  for (const double apart : {1e-3, 4e-6}) {
    const auto rows = nearly_collinear(413, kRows, apart);
    for (const double keep : {1.0, 0.999}) {
      RecursiveQr<kUnknowns> qr;
      for (const Row& r : rows) qr.add({r[0], r[1], r[2], r[3]}, r[4], keep);
      const auto x = qr.solve();
      const auto want = batch(rows, keep);
      long double error = 0, size = 0;
      for (std::size_t k = 0; k < kUnknowns; ++k) {
        const long double d = static_cast<long double>(x[k]) - want[k];
        error += d * d;
        size += want[k] * want[k];
      }
      const auto relative = static_cast<double>(std::sqrt(error / size));
      std::printf("  condition %.3g, forgetting %g: relative difference %.2g\n", qr.condition(),
                  keep, relative);
      EXPECT_LE(qr.condition(), 1e6);
      EXPECT_GE(qr.condition(), 0.3 / apart);
      EXPECT_LE(relative, 1e-9);
      EXPECT_EQ(qr.rows(), kRows);
    }
  }
}

// Beyond: with a prior p no answer is longer than |b| / (2 p), whatever the rows; without one it is finite.
TEST(RecursiveQr, IsBoundedWhereTheConditionIsWorse) {
  for (const double apart : {1e-8, 1e-12, 1e-16, 0.0}) {
    const auto rows = nearly_collinear(414, 20000, apart);
    RecursiveQr<kUnknowns> with(0.1), without;
    double b2 = 0;
    for (const Row& r : rows) {
      with.add({r[0], r[1], r[2], r[3]}, r[4], 1);
      without.add({r[0], r[1], r[2], r[3]}, r[4], 1);
      b2 += r[4] * r[4];
    }
    double size = 0;
    for (const double v : with.solve()) size += v * v;
    EXPECT_LE(std::sqrt(size), std::sqrt(b2) / (2 * 0.1)) << apart;
    for (const double v : without.solve()) EXPECT_TRUE(std::isfinite(v)) << apart;
    EXPECT_GT(without.condition(), 1e6) << apart;
  }
}

TEST(RecursiveQr, BadRowsAreIgnoredAndNothingIsZero) {
  RecursiveQr<2> qr;
  EXPECT_EQ(qr.solve()[0], 0);
  qr.add({std::nan(""), 1}, 1, 1);
  qr.add({1, 1}, std::numeric_limits<double>::infinity(), 1);
  EXPECT_EQ(qr.rows(), 0U);
  qr.add({2, 0}, 6, 1);
  EXPECT_DOUBLE_EQ(qr.solve()[0], 3);
  EXPECT_EQ(qr.solve()[1], 0) << "no row speaks of it";
  qr.clear();
  EXPECT_EQ(qr.solve()[0], 0);
}

}  // namespace
