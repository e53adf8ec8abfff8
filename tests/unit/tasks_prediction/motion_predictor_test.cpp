#include "tasks/prediction/motion_predictor.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using perception::Pose2;
using perception::Twist2;
using tasks::MotionPredictor;
using tasks::MotionPredictorConfig;
using tasks::MotionSample;

// The regularised problem as a stacked least-squares problem, by Eigen's QR: min |[A; sqrt(L)] x -
// [b; 0]|.
Eigen::Vector2d by_qr(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double l1, double l2) {
  Eigen::MatrixXd S(A.rows() + 2, 2);
  S << A, std::sqrt(l1), 0, 0, std::sqrt(l2);
  Eigen::VectorXd y(b.size() + 2);
  y << b, 0, 0;
  return S.colPivHouseholderQr().solve(y);
}

TEST(RidgeSolve, EqualsQrOfTheStackedProblem) {
  const std::uint64_t seed = 81;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    const int n = static_cast<int>(random.integer(1, 40));
    Eigen::MatrixXd A(n, 2);
    Eigen::VectorXd b(n);
    for (int r = 0; r < n; ++r) {
      A(r, 0) = random.normal();
      A(r, 1) = random.uniform() < 0.3 ? A(r, 0) : random.normal();
      b[r] = random.normal();
    }
    const double l1 = std::pow(10, random.uniform(-4, 2)), l2 = std::pow(10, random.uniform(-4, 2));
    const Eigen::Matrix2d M = A.transpose() * A;
    const Eigen::Vector2d v = A.transpose() * b;
    const auto x = tasks::ridge_solve(M(0, 0), M(0, 1), M(1, 1), v[0], v[1], l1, l2);
    const Eigen::Vector2d want = by_qr(A, b, l1, l2);
    Eigen::MatrixXd stacked(n + 2, 2);
    stacked << A, Eigen::Matrix2d(Eigen::Vector2d(std::sqrt(l1), std::sqrt(l2)).asDiagonal());
    const Eigen::VectorXd s = stacked.jacobiSvd().singularValues();
    const double condition = tasks::ridge_condition(M(0, 0), M(0, 1), M(1, 1), l1, l2);
    ASSERT_NEAR(condition, s[0] / s[1], 1e-6 * condition) << "seed " << seed << " case " << i;
    ASSERT_NEAR(x[0], want[0], 1e-7 * (1 + want.norm())) << "seed " << seed << " case " << i;
    ASSERT_NEAR(x[1], want[1], 1e-7 * (1 + want.norm())) << "seed " << seed << " case " << i;
  }
}

TEST(RidgeSolve, IllConditionedStaysFinite) {
  for (const double scale : {1e-12, 1.0, 1e6}) {
    // Two equal columns, and no data at all.
    const auto x = tasks::ridge_solve(scale, scale, scale, scale, scale, 1e-9, 1e-9);
    EXPECT_TRUE(std::isfinite(x[0]) && std::isfinite(x[1])) << scale;
    EXPECT_LT(std::abs(x[0]) + std::abs(x[1]), 2.0) << scale;
  }
  EXPECT_EQ(tasks::ridge_condition(1, 1, 1, 0, 0), INFINITY);
  EXPECT_EQ(tasks::ridge_condition(0, 0, 0, 1e-6, 1e-6), 1);
  const auto none = tasks::ridge_solve(0, 0, 0, 0, 0, 1e-6, 1e-6);
  EXPECT_EQ(none[0], 0);
  EXPECT_EQ(none[1], 0);
}

// The predictor's own fit against the same training set built here and solved by QR.
TEST(MotionPredictor, LearnedCorrectionEqualsTheSlowReference) {
  MotionPredictorConfig c;
  c.method = "lsq";
  c.acceleration_limit_m_per_s2 = 100;
  c.yaw_acceleration_limit_rad_per_s2 = 100;
  MotionPredictor predictor(c);
  std::vector<MotionSample> log;
  const auto speed = [](double t) { return 0.3 + 0.2 * std::sin(0.9 * t); };
  Pose2 X;
  // One sample a little earlier makes clear which training instant is the first.
  ASSERT_TRUE(predictor.add({-0.05, {-0.05 * speed(0), 0, 0}, {speed(0), 0, 0}}));
  for (int i = 0; i <= 200; ++i) {
    const double t = 0.1 * i;
    log.push_back({t, X, {speed(t), 0, 0}});
    ASSERT_TRUE(predictor.add(log.back()));
    X.x += 0.05 * (speed(t) + speed(t + 0.1));
  }
  const double h = 0.5, now = 20.0;
  // All instants fall on samples, so no interpolation is needed here.
  const auto v = [&](double t) { return speed(t); };
  const auto x = [&](double t) {
    return log[static_cast<std::size_t>(std::lround(t * 10))].X_OB.x;
  };
  std::vector<Eigen::Vector3d> rows;
  for (int n = 0; n < 300; ++n) {
    const double q = now - h - 0.1 * n;
    if (q - 0.3 < -1e-9) break;
    rows.emplace_back(v(q) - v(q - 0.1), v(q) - v(q - 0.3), (x(q + h) - x(q)) / h - v(q));
  }
  Eigen::MatrixXd A(rows.size(), 2);
  Eigen::VectorXd b(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    A.row(static_cast<Eigen::Index>(i)) = rows[i].head<2>().transpose();
    b[static_cast<Eigen::Index>(i)] = rows[i][2];
  }
  const double lambda = c.prior_samples * c.speed_scale_m_per_s * c.speed_scale_m_per_s;
  const Eigen::Vector2d theta = by_qr(A, b, lambda, lambda);
  const double want =
      v(now) + theta[0] * (v(now) - v(now - 0.1)) + theta[1] * (v(now) - v(now - 0.3));
  MotionPredictor::Prediction p;
  ASSERT_TRUE(predictor.predict(now + h, p));
  EXPECT_NEAR(p.mean_B.vx, want, 1e-9);
  EXPECT_GT(std::abs(want - v(now)), 1e-3);  // it did learn something
}

// Speeding up and slowing down at a steady rate: the learned trend beats the held velocity.
TEST(MotionPredictor, LearnsRamps) {
  MotionPredictorConfig hold;
  hold.method = "hold";
  MotionPredictor learned, held(hold);
  double x = 0, v = 0, error_lsq = 0, error_hold = 0;
  const double h = 0.5;
  std::vector<std::pair<double, double>> at;  // predicted by lsq, by hold, for later
  std::vector<double> xs;
  for (int i = 0; i < 1200; ++i) {
    const MotionSample s{0.05 * i, {x, 0, 0}, {v, 0, 0}};
    learned.add(s);
    held.add(s);
    MotionPredictor::Prediction a, b;
    ASSERT_TRUE(learned.predict(s.t + h, a));
    ASSERT_TRUE(held.predict(s.t + h, b));
    at.emplace_back(a.X_OB.x, b.X_OB.x);
    xs.push_back(x);
    const double next = 0.5 * std::abs(std::fmod(0.05 * (i + 1), 8.0) - 4.0) / 2.0;
    x += 0.5 * (v + next) * 0.05;
    v = next;
  }
  for (std::size_t i = 300; i + 10 < at.size(); ++i) {
    error_lsq += std::pow(at[i].first - xs[i + 10], 2);
    error_hold += std::pow(at[i].second - xs[i + 10], 2);
  }
  EXPECT_LT(error_lsq, 0.5 * error_hold);
}

TEST(MotionPredictor, HoldIsAnExactArcAndNoneStandsStill) {
  MotionPredictorConfig c;
  for (const char* method : {"none", "hold", "lsq"}) {
    c.method = method;
    MotionPredictor p(c);
    MotionPredictor::Prediction out;
    EXPECT_FALSE(p.predict(1, out));
    ASSERT_TRUE(p.add({5, {1, 2, 3}, {0.4, 0.1, 0.7}}));
    ASSERT_TRUE(p.predict(5.8, out));
    const Pose2 want = c.method == "none" ? Pose2{1, 2, 3}
                                          : perception::integrate({1, 2, 3}, {0.4, 0.1, 0.7}, 0.8);
    EXPECT_NEAR(out.X_OB.x, want.x, 1e-12) << method;
    EXPECT_NEAR(out.X_OB.y, want.y, 1e-12) << method;
    EXPECT_NEAR(out.X_OB.yaw, want.yaw, 1e-12) << method;
    ASSERT_TRUE(p.predict(4, out));  // not later than what is known
    EXPECT_EQ(out.X_OB, (Pose2{1, 2, 3}));
  }
}

TEST(MotionPredictor, ConstantMotionGivesNoCorrectionAndStaysFinite) {
  MotionPredictor p;
  MotionPredictor::Prediction out;
  Pose2 X;
  const Twist2 v{0.3, -0.1, 0.2};
  for (int i = 0; i < 3000; ++i) {
    rt::Section section;
    ASSERT_TRUE(p.add({0.02 * i, X, v}));
    ASSERT_TRUE(p.predict(0.02 * i + 0.4, out));
    const Pose2 want = perception::integrate(X, v, 0.4);
    ASSERT_NEAR(out.X_OB.x, want.x, 1e-9);
    ASSERT_NEAR(out.X_OB.y, want.y, 1e-9);
    X = perception::integrate(X, v, 0.02);
  }
}

TEST(MotionPredictor, RefusesWhatCanNotBeTrue) {
  MotionPredictor p;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(p.add({nan, {}, {}}));
  EXPECT_FALSE(p.add({0, {nan, 0, 0}, {}}));
  EXPECT_FALSE(p.add({0, {}, {0, nan, 0}}));
  EXPECT_TRUE(p.add({0, {}, {}}));
  EXPECT_FALSE(p.add({0, {1, 1, 1}, {}}));
  EXPECT_FALSE(p.add({-1, {}, {}}));
  EXPECT_FALSE(p.add_command(0, {nan, 0, 0}));
  EXPECT_EQ(p.size(), 1U);
  MotionPredictorConfig c;
  c.method = "magic";
  EXPECT_THROW(MotionPredictor{c}, std::invalid_argument);
}

// Wild velocities: the correction stays inside what the acceleration limit allows.
TEST(MotionPredictor, CorrectionIsBounded) {
  const std::uint64_t seed = 83;
  rt::Random random(seed);
  MotionPredictorConfig c;
  MotionPredictor p(c);
  double t = 0;
  for (int i = 0; i < 2000; ++i) {
    t += random.uniform(0.001, 0.2);
    const Twist2 v{random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-5, 5)};
    p.add({t, {random.uniform(-5, 5), 0, 0}, v});
    const double h = random.uniform(0.01, 2);
    MotionPredictor::Prediction out;
    ASSERT_TRUE(p.predict(t + h, out));
    ASSERT_TRUE(perception::is_finite(out.X_OB)) << "seed " << seed;
    ASSERT_LE(std::abs(out.mean_B.vx - v.vx), 0.5 * h * c.acceleration_limit_m_per_s2 + 1e-12);
    ASSERT_LE(std::abs(out.mean_B.wz - v.wz),
              0.5 * h * c.yaw_acceleration_limit_rad_per_s2 + 1e-12);
  }
}

// A fast source is thinned, the newest sample is never lost, and a week of samples fits.
TEST(MotionPredictor, FastSourceKeepsTheNewest) {
  MotionPredictor p;
  for (int i = 0; i < 100000; ++i) {
    ASSERT_TRUE(p.add({0.001 * i, {0.0005 * i, 0, 0}, {0.5, 0, 0}}));
    ASSERT_EQ(p.newest().t, 0.001 * i);
    ASSERT_LE(p.size(), 2048U);
  }
  Pose2 X;
  ASSERT_TRUE(p.pose_at(95.12345, X));
  EXPECT_NEAR(X.x, 0.5 * 95.12345, 1e-9);
  EXPECT_FALSE(p.pose_at(1.0, X));
  EXPECT_FALSE(p.pose_at(100.5, X));
}

// Pose between two samples of an arc lies on the arc.
TEST(MotionPredictor, PoseBetweenSamplesIsOnTheArc) {
  MotionPredictor p;
  const Twist2 v{0.5, 0.2, 1.3};
  p.add({0, {1, 1, 1}, v});
  p.add({1, perception::integrate({1, 1, 1}, v, 1), v});
  for (const double t : {0.0, 0.25, 0.7, 1.0}) {
    Pose2 X;
    ASSERT_TRUE(p.pose_at(t, X));
    const Pose2 want = perception::integrate({1, 1, 1}, v, t);
    EXPECT_NEAR(X.x, want.x, 1e-12);
    EXPECT_NEAR(X.y, want.y, 1e-12);
    EXPECT_NEAR(perception::wrap_angle(X.yaw - want.yaw), 0, 1e-12);
  }
}

}  // namespace
