// All methods behind the one interface: hard histories, oracles of the filters, covariance,
// mixture, hand-back.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tasks/prediction/hand_back.hpp"
#include "tasks/prediction/motion_predictor.hpp"

namespace {

using perception::Pose2;
using perception::Twist2;
using tasks::Axes;
using tasks::MotionHistory;
using tasks::MotionPredictor;
using tasks::MotionPredictorConfig;
using tasks::MotionSample;

std::vector<std::string> methods() { return MotionPredictorConfig::methods(); }

MotionPredictor of(const std::string& method) {
  MotionPredictorConfig c;
  c.method = method;
  return MotionPredictor(c);
}

bool finite(const MotionPredictor::Prediction& p) {
  return perception::is_finite(p.X_OB) && perception::is_finite(p.mean_B) &&
         p.covariance.allFinite();
}

TEST(Methods, TheOldNamesStillName) {
  for (const char* name : {"none", "hold", "lsq"}) {
    const auto all = methods();
    EXPECT_NE(std::find(all.begin(), all.end(), name), all.end());
  }
  EXPECT_EQ(MotionPredictorConfig{}.method, "own");
  MotionPredictor a = of("hold"), b = of("constant_velocity");
  MotionPredictor::Prediction pa, pb;
  for (int i = 0; i < 50; ++i) {
    const MotionSample s{0.1 * i, {0.02 * i, 0, 0.1}, {0.2 + 0.01 * i, 0.1, -0.3}};
    ASSERT_TRUE(a.add(s) && b.add(s));
    ASSERT_TRUE(a.predict(s.t + 0.2, pa) && b.predict(s.t + 0.2, pb));
    EXPECT_EQ(pa.X_OB, pb.X_OB);
    EXPECT_EQ(pa.covariance, pb.covariance);
  }
}

// What all but `none` say of a motion that does not change: it goes on. A ridge pulls towards rest
// by its share.
TEST(Methods, ConstantAndZeroHistoriesGoOn) {
  for (const std::string& m : methods()) {
    for (const Twist2 v : {Twist2{0.4, -0.2, 0.5}, Twist2{}}) {
      MotionPredictor p = of(m);
      MotionPredictor::Prediction out;
      Pose2 X;
      for (int i = 0; i < 200; ++i) {
        rt::Section section;  // noexcept, no allocation, no lock
        ASSERT_TRUE(p.add({0.05 * i, X, v})) << m;
        ASSERT_TRUE(p.predict(0.05 * i + 0.2, out)) << m;
        X = perception::integrate(X, v, 0.05);
      }
      const Pose2 want =
          m == "none" ? p.newest().X_OB : perception::integrate(p.newest().X_OB, v, 0.2);
      const double tolerance = m == "ridge" ? 1e-3 : 1e-9;
      EXPECT_NEAR(out.X_OB.x, want.x, tolerance) << m;
      EXPECT_NEAR(out.X_OB.y, want.y, tolerance) << m;
      EXPECT_NEAR(perception::wrap_angle(out.X_OB.yaw - want.yaw), 0, tolerance) << m;
      EXPECT_TRUE(finite(out)) << m;
    }
  }
}

// Velocities that are copies of each other, grow without end, jump, come after gaps of every size,
// twice, or as no numbers: every answer is finite, and bounded by what the method states.
TEST(Methods, HardHistoriesGiveFiniteAnswers) {
  const std::uint64_t seed = 421;
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               inf = std::numeric_limits<double>::infinity();
  for (const std::string& m : methods()) {
    for (const char* kind : {"collinear", "exploding", "alternating", "gapped", "broken", "tiny"}) {
      const std::string what = m + ", " + kind + ", seed " + std::to_string(seed);
      rt::Random random(seed);
      MotionPredictor p = of(m);
      MotionPredictor::Prediction out;
      double t = 0;
      for (int i = 0; i < 400; ++i) {
        t += std::string(kind) == "gapped" ? std::pow(10, random.uniform(-4, 2)) : 0.05;
        double v = 0.3 + 0.1 * std::sin(0.3 * i);
        if (std::string(kind) == "exploding") v = std::min(std::pow(1.1, i), 4e5);
        if (std::string(kind) == "alternating") v = i % 2 == 0 ? 1e3 : -1e3;
        if (std::string(kind) == "tiny") v = 1e-200 * i;
        const Twist2 twist{v, 2 * v, -0.5 * v};
        if (std::string(kind) == "broken" && i % 3 == 1) {
          EXPECT_FALSE(p.add({t, {}, {nan, 0, 0}})) << what;
          EXPECT_FALSE(p.add({t, {0, -inf, 0}, twist})) << what;
          EXPECT_FALSE(p.add({nan, {}, twist})) << what;
          EXPECT_FALSE(p.add({t, {}, {1e7, 0, 0}})) << what;
          if (i > 3) {
            EXPECT_FALSE(p.add({t - 0.05, {}, twist})) << what;
          }
          continue;
        }
        rt::Section section;
        ASSERT_TRUE(p.add({t, {0.1 * i, 0, 0}, twist})) << what;
        ASSERT_FALSE(p.add({t, {9, 9, 9}, twist})) << what << ": twice";
        for (const double h : {1e-6, 0.01, 0.2, 3.0, 100.0}) {
          ASSERT_TRUE(p.predict(t + h, out)) << what;
          ASSERT_TRUE(finite(out)) << what << " t " << t << " h " << h;
          ASSERT_GE(out.covariance.diagonal().minCoeff(), 0) << what;
          if (m == "paper" || m == "ridge") {
            // It is allowed to diverge up to the stated bound, and the last velocity is its own.
            ASSERT_LE(std::abs(out.mean_B.vx), std::max(5.0, std::abs(twist.vx)) + 1e-9) << what;
          }
        }
      }
    }
  }
}

// The condition of a collinear history is reported as what it is: rank one, and the answer of least
// norm.
TEST(LinearModel, CollinearHistoryHasRankOneAndTheLeastNorm) {
  MotionHistory history;
  const tasks::LinearModel model({3, 20, 0});
  // v(k + 1) = 0.9 v(k) on one line: every row of Phi is a multiple of one vector.
  double v = 0.8;
  const Axes line{1, -0.5, 2};
  for (int i = 0; i < 30; ++i, v *= 0.9)
    ASSERT_TRUE(history.add({0.1 * i, {}, {v * line[0], v * line[1], v * line[2]}}));
  const tasks::LinearFit fit = model.fit(history);
  EXPECT_EQ(fit.rank, 1);
  EXPECT_NEAR(fit.condition, 1, 1e-9);
  // X = a y^T / |a|^2 for a = [l, l / 0.9, l / 0.81], y = 0.9 l.
  Eigen::VectorXd a(9);
  Eigen::Vector3d l(line[0], line[1], line[2]);
  a << l, l / 0.9, l / 0.81;
  const Eigen::MatrixXd want = a * (0.9 * l).transpose() / a.squaredNorm();
  EXPECT_LE((fit.X - want).norm(), 1e-9);
}

// A motion that is of the model is predicted exactly: a damped oscillation of three coupled axes.
TEST(LinearModel, FindsALinearMotion) {
  tasks::MotionPredictorConfig config;
  config.method = "paper";
  config.acceleration_limit_m_per_s2 = config.yaw_acceleration_limit_rad_per_s2 = 100;  // no bound
  MotionPredictor p(config);
  const Eigen::Matrix3d F =
      (Eigen::Matrix3d() << 0.95, 0.2, 0, -0.2, 0.95, 0.1, 0, -0.1, 0.97).finished();
  Eigen::Vector3d v(0.5, 0.2, -0.4);
  for (int i = 0; i < 30; ++i) {
    ASSERT_TRUE(p.add({0.1 * i, {}, {v[0], v[1], v[2]}}));
    v = F * v;
  }
  MotionPredictor::Prediction out;
  ASSERT_TRUE(p.predict(2.9 + 0.2, out));
  const Eigen::Vector3d before = F.inverse() * v, next = F * v;
  const Eigen::Vector3d want = 0.25 * before + 0.5 * v + 0.25 * next;  // trapezoids over two steps
  EXPECT_NEAR(out.mean_B.vx, want[0], 1e-9);
  EXPECT_NEAR(out.mean_B.vy, want[1], 1e-9);
  EXPECT_NEAR(out.mean_B.wz, want[2], 1e-9);
}

// A turn of the wheel that no base can make: what the fit says of it is bounded, whatever it says.
TEST(Bound, NoMethodLeavesWhatTheLimitsAllow) {
  const std::uint64_t seed = 61;
  std::printf("seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  const tasks::MotionPredictorConfig limits;
  for (const std::string& method : tasks::MotionPredictorConfig::methods()) {
    if (method == "none") continue;
    MotionPredictor p = of(method.c_str());
    double t = 0;
    for (int i = 0; i < 400; ++i) {
      t += random.uniform(0.02, 0.1);
      const perception::Twist2 v{random.uniform(-1, 1), 0.001 * random.normal(),
                                 random.uniform(-2, 2)};
      ASSERT_TRUE(p.add({t, {}, v}));
      const double h = random.uniform(0.05, 0.5);
      MotionPredictor::Prediction out;
      ASSERT_TRUE(p.predict(t + h, out));
      const double reach = 0.5 * limits.acceleration_limit_m_per_s2 * h + 1e-9;
      EXPECT_LE(std::abs(out.mean_B.vx - v.vx), reach) << method << " " << i;
      EXPECT_LE(std::abs(out.mean_B.vy - v.vy), reach) << method << " " << i;
      EXPECT_LE(std::abs(out.mean_B.wz - v.wz),
                0.5 * limits.yaw_acceleration_limit_rad_per_s2 * h + 1e-9)
          << method << " " << i;
    }
  }
}

// The filter's velocity and acceleration against the most likely states of the whole history at
// once: one least-squares problem over all states, weighed by the same noises.
TEST(AccelerationFilter, EqualsTheBatchSolution) {
  const std::uint64_t seed = 422;
  for (const double T : {0.0, 0.3}) {
    rt::Random random(seed);
    tasks::AccelerationFilter filter({T, {4, 4, 4}, {0.01, 0.01, 0.01}});
    MotionHistory history;
    std::vector<double> ts, zs;
    double t = 0;
    for (int i = 0; i < 25; ++i) {
      t += random.uniform(0.03, 0.12);
      ts.push_back(t);
      zs.push_back(0.3 * std::sin(2 * t) + 0.01 * random.normal());
      ASSERT_TRUE(history.add({t, {}, {zs.back(), 0, 0}}));
      filter.add(history);
    }
    const auto n = static_cast<Eigen::Index>(ts.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(4 * n, 2 * n);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(4 * n);
    Eigen::Index row = 0;
    A(row, 1) = 1 / std::sqrt(4.0), b[row++] = 0;  // the prior of the first acceleration
    for (Eigen::Index i = 0; i < n; ++i) {
      A(row, 2 * i) = 100, b[row++] = 100 * zs[static_cast<std::size_t>(i)];
      if (i == 0) continue;
      const double dt = ts[static_cast<std::size_t>(i)] - ts[static_cast<std::size_t>(i - 1)];
      Eigen::Matrix2d F, Q = Eigen::Matrix2d::Zero();
      const double e = T > 0 ? std::exp(-dt / T) : 1;
      F << 1, (T > 0 ? T * (1 - e) : dt), 0, e;
      const int steps = 4000;  // Q by the sum of what a thousandth of jerk does until the end
      for (int k = 0; k < steps; ++k) {
        const double left = dt * (k + 0.5) / steps, el = T > 0 ? std::exp(-left / T) : 1;
        const Eigen::Vector2d g((T > 0 ? T * (1 - el) : left), el);
        Q += 4 * dt / steps * g * g.transpose();
      }
      const Eigen::Matrix2d W = Q.llt().matrixL().solve(Eigen::Matrix2d::Identity());
      A.block(row, 2 * i, 2, 2) = W;
      A.block(row, 2 * i - 2, 2, 2) = -W * F;
      row += 2;
    }
    const Eigen::VectorXd x = A.topRows(row).householderQr().solve(b.head(row));
    const double v = x[2 * n - 2], a = x[2 * n - 1], h = 0.2;
    const double way =
        T > 0 ? v * h + a * T * (h - T * (1 - std::exp(-h / T))) : v * h + a * h * h / 2;
    tasks::Motion out;
    ASSERT_TRUE(filter.predict(history, h, out));
    EXPECT_NEAR(out.mean()[0], way / h, 1e-5) << "T " << T << " seed " << seed;
    EXPECT_GT(std::abs(a), 0.05);
  }
}

// The stated covariance against what the errors turn out to be: the mean of e^T C^-1 e of two
// places is 2.
TEST(Methods, StatedCovarianceIsOfTheSizeOfTheErrors) {
  for (const std::string& m : methods()) {
    rt::Random random(423);
    MotionPredictor p = of(m);
    Pose2 X;
    Twist2 v;
    std::vector<MotionSample> log;
    std::vector<MotionPredictor::Prediction> said;
    for (int i = 0; i < 3000; ++i) {
      v.vx = 0.97 * v.vx + 0.02 * random.normal();
      v.vy = 0.97 * v.vy + 0.02 * random.normal();
      v.wz = 0.97 * v.wz + 0.05 * random.normal();
      log.push_back({0.05 * i, X, v});
      ASSERT_TRUE(p.add(log.back()));
      said.emplace_back();
      ASSERT_TRUE(p.predict(0.05 * i + 0.2, said.back()));
      X = perception::integrate(X, v, 0.05);
    }
    double sum = 0;
    int count = 0, beyond = 0;
    for (std::size_t i = 1000; i + 4 < log.size(); ++i) {  // the prior has faded
      const Pose2 to_B = perception::inverse(log[i].X_OB);
      const Pose2 is = perception::compose(to_B, log[i + 4].X_OB),
                  was = perception::compose(to_B, said[i].X_OB);
      const Eigen::Vector2d e(is.x - was.x, is.y - was.y);
      const double share = e.dot(said[i].covariance.topLeftCorner<2, 2>().inverse() * e);
      sum += share;
      beyond += share > 13.8 ? 1 : 0;  // chi-square, two degrees, 0.999
      ++count;
    }
    std::printf("  %-18s e^T C^-1 e %.2f in the mean (2 wanted), above the 0.999 gate %.2f %%\n",
                m.c_str(), sum / count, 100.0 * beyond / count);
    EXPECT_GT(sum / count, 1.0) << m;
    EXPECT_LT(sum / count, 3.5) << m;
  }
}

// Two seconds after the motion changes its kind, the mixture is nearly as good as the best model of
// the new kind.
TEST(Mixture, GoesWithTheBestOfTheMoment) {
  rt::Random random(424);
  std::vector<MotionSample> log;
  double x = 0, v = 0;
  for (int i = 0; i < 2400; ++i) {
    const double t = 0.05 * i;
    // Smooth oscillation for 20 s, then steady with noise, and again.
    const bool smooth = static_cast<int>(t / 20) % 2 == 0;
    const double noisy = smooth ? 0 : 0.03 * random.normal();
    log.push_back({t, {x, 0, 0}, {v + noisy, 0, 0}});
    const double next = smooth ? 0.3 + 0.3 * std::sin(2 * (t + 0.05)) : v;
    x += 0.5 * (v + next) * 0.05;
    v = next;
  }
  std::map<std::string, std::array<double, 2>> error;
  for (const std::string& m : methods()) {
    MotionPredictor p = of(m);
    for (std::size_t i = 0; i + 4 < log.size(); ++i) {
      MotionPredictor::Prediction out;
      ASSERT_TRUE(p.add(log[i]));
      ASSERT_TRUE(p.predict(log[i].t + 0.2, out));
      const double in_part = std::fmod(log[i].t, 20);
      if (in_part < 3 || log[i].t < 20) continue;
      error[m][static_cast<int>(log[i].t / 20) % 2] += std::abs(out.X_OB.x - log[i + 4].X_OB.x);
    }
  }
  for (const int part : {0, 1}) {
    double best = 1e9;
    for (const char* m : {"constant_velocity", "ridge", "kalman", "singer"})
      best = std::min(best, error[m][static_cast<std::size_t>(part)]);
    const double own = error["own"][static_cast<std::size_t>(part)];
    std::printf("  %s: own over the best simple one %.3f\n", part == 0 ? "smooth" : "noisy",
                own / best);
    EXPECT_LT(own, 1.25 * best);
  }
}

TEST(HandBack, IsContinuousAndFades) {
  tasks::HandBack back({0.1, 0.3, 0.6});
  const Pose2 before{1, 2, 3.1}, after{1.04, 1.97, -3.1};
  back.take(5, before, after);
  Pose2 X = back.show(5, after);
  EXPECT_NEAR(X.x, before.x, 1e-12);
  EXPECT_NEAR(X.y, before.y, 1e-12);
  EXPECT_NEAR(perception::wrap_angle(X.yaw - before.yaw), 0, 1e-12);
  X = back.show(5.1, after);
  EXPECT_NEAR(X.x, 1.04 - 0.04 * std::exp(-1.0), 1e-12);
  // A second measurement on the way: what is shown goes on from where it is.
  const Pose2 third{1.0, 2.0, 3.12}, was = back.show(5.05, after);
  back.take(5.05, after, third);
  X = back.show(5.05, third);
  EXPECT_NEAR(X.x, was.x, 1e-12);
  EXPECT_NEAR(X.y, was.y, 1e-12);
  X = back.show(6.5, third);
  EXPECT_NEAR(X.x, third.x, 1e-6);
  // Another place altogether is no correction.
  back.take(7, third, {5, 5, 0});
  EXPECT_EQ(back.jumps(), 1U);
  EXPECT_EQ(back.show(7, {5, 5, 0}), (Pose2{5, 5, 0}));
  back.take(8, {5, 5, 0}, {std::nan(""), 0, 0});
  EXPECT_EQ(back.jumps(), 2U) << "no offset from what is no number";
  EXPECT_EQ(back.show(8, {1, 1, 0}), (Pose2{1, 1, 0}));
}

// With commands on their way the response is found, and the commands count.
TEST(Methods, KnownCommandsCountWithOwnAndLsq) {
  std::map<std::string, double> error;
  for (const char* m : {"own", "lsq"}) {
    for (const bool commands : {false, true}) {
      MotionPredictor p = of(m);
      double x = 0, v = 0, sum = 0;
      std::vector<std::pair<double, double>> at;
      std::vector<double> xs;
      for (int i = 0; i < 1200; ++i) {
        const double t = 0.05 * i;
        const auto command = [](double s) {
          return static_cast<int>(s / 1.7) % 2 == 0 ? 0.5 : 0.1;
        };
        if (commands) (void)p.add_command(t + 0.2, {command(t + 0.2), 0, 0});
        ASSERT_TRUE(p.add({t, {x, 0, 0}, {v, 0, 0}}));
        MotionPredictor::Prediction out;
        ASSERT_TRUE(p.predict(t + 0.2, out));
        at.emplace_back(t, out.X_OB.x);
        xs.push_back(x);
        for (int k = 0; k < 50; ++k) {
          v += (command(t) - v) / 0.25 * 0.001;
          x += v * 0.001;
        }
      }
      for (std::size_t i = 200; i + 4 < at.size(); ++i) sum += std::abs(at[i].second - xs[i + 4]);
      error[m + std::string(commands ? "+" : "")] = sum;
    }
    EXPECT_LT(error[m + std::string("+")], 0.35 * error[m]) << m;
  }
}

// What was solved says how well it was posed; what solves nothing says 0. A motion that does not
// change has rank one.
TEST(Methods, TheConditionIsStated) {
  for (const std::string& m : methods()) {
    for (const bool varied : {false, true}) {
      MotionPredictor p = of(m);
      MotionPredictor::Prediction out;
      Pose2 X;
      rt::Random random(431);
      for (int i = 0; i < 200; ++i) {
        const Twist2 v = varied ? Twist2{random.normal(), random.normal(), random.normal()}
                                : Twist2{0.4, -0.2, 0.5};
        ASSERT_TRUE(p.add({0.05 * i, X, v})) << m;
        ASSERT_TRUE(p.predict(0.05 * i + 0.2, out)) << m;
        X = perception::integrate(X, v, 0.05);
      }
      std::printf("  %s, %s: condition %.3g\n", m.c_str(), varied ? "varied" : "constant",
                  out.condition);
      const bool solves = m == "paper" || m == "ridge" || m == "lsq" || m == "own";
      EXPECT_EQ(out.condition > 0, solves) << m;
      EXPECT_TRUE(!solves || out.condition >= 1) << m;
      EXPECT_TRUE(!varied || out.condition < 1e3) << m;
      EXPECT_TRUE(m != "paper" || varied || std::abs(out.condition - 1) < 1e-6);
    }
  }
}

}  // namespace
