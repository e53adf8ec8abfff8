// The filter against a closed form (a straight way), brute force (odometry with drawn errors), a
// batch least-squares solution that shares no code with it, and the plant's own slipping wheels.
#include "tasks/prediction/world_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <vector>

#include "drivers/youbot/robot_plant.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using perception::compose;
using perception::inverse;
using perception::Pose2;
using tasks::WorldFilter;
using tasks::WorldFilterConfig;
using Taken = WorldFilter::Taken;

constexpr double kDegree = M_PI / 180;

double error_of(const Eigen::Matrix3d& P) {
  return 3 * std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(P.topLeftCorner<2, 2>())
                           .eigenvalues()
                           .maxCoeff());
}

// Along: share of the way; aside: the share, and a heading that drifts evenly, g s^2 / 2. However
// many steps it takes, also more than the filter remembers, and from any heading.
TEST(WorldFilter, AStraightWayWithoutCameraAsInClosedForm) {
  WorldFilterConfig c;
  c.odometry_translation_share = 0.03;
  c.odometry_deg_per_m = 2;
  for (const int steps : {1, 9, 1000}) {
    for (const double yaw : {0.0, 1.1}) {
      WorldFilter f(c, true);
      const double s = 2.5, g = 2 * kDegree;
      for (int i = 0; i <= steps; ++i) {
        const double x = s * i / steps;
        ASSERT_TRUE(f.add_odometry(0.1 * i, {x * std::cos(yaw), x * std::sin(yaw), yaw}));
      }
      const double along = std::hypot(0.03 * s, 0.005);
      const double aside = std::sqrt(std::pow(0.03 * s, 2) + std::pow(g * s * s / 2, 2) + 25e-6);
      const Eigen::Matrix3d P = f.covariance();
      const Eigen::Vector2d u(std::cos(yaw), std::sin(yaw)), v(-u.y(), u.x());
      const Eigen::Matrix2d Q = P.topLeftCorner<2, 2>();
      EXPECT_NEAR(std::sqrt(u.dot(Q * u)), along, 1e-9) << steps;
      EXPECT_NEAR(std::sqrt(v.dot(Q * v)), aside, 1e-9) << steps;
      EXPECT_NEAR(std::sqrt(P(2, 2)), std::hypot(g * s, 0.3 * kDegree), 1e-9);
      EXPECT_NEAR(f.error_m(), 3 * std::max(along, aside), 1e-9);
      EXPECT_NEAR(f.error_m(), error_of(P), 1e-9);
      EXPECT_EQ(f.X_WO(), Pose2{}) << "nothing said otherwise";
    }
  }
}

TEST(WorldFilter, WhatIsAheadIsStatedAsIfItHadBeenDriven) {
  WorldFilter here(WorldFilterConfig{}, true), there(WorldFilterConfig{}, true);
  for (int i = 0; i <= 20; ++i) {
    ASSERT_TRUE(here.add_odometry(i, {0.05 * i, 0, 0.4}));
    ASSERT_TRUE(there.add_odometry(i, {0.05 * i, 0, 0.4}));
  }
  ASSERT_TRUE(there.add_odometry(21, {1.3, 0.2, 0.4}));
  EXPECT_NEAR(here.error_after_m(0.3, 0.2), there.error_m(), 1e-12);
  EXPECT_LT(here.error_m(), there.error_m());
  EXPECT_EQ(here.error_after_m(0, 0), here.error_m());
}

// A bent way with turns: the base as it truly goes when the four shares are drawn, each step by
// itself.
TEST(WorldFilter, ABentWayAsByBruteForce) {
  WorldFilterConfig c;
  c.odometry_translation_share = 0.02;
  c.odometry_rotation_share = 0.03;
  c.odometry_deg_per_m = 1.0;
  std::vector<Pose2> way{{0.3, -0.2, 0.7}};
  for (int i = 0; i < 300; ++i) {
    way.push_back(perception::integrate(
        way.back(), {0.4, 0.1 * std::sin(0.05 * i), 0.5 * std::cos(0.03 * i)}, 0.02));
  }
  WorldFilter f(c, true);
  for (std::size_t i = 0; i < way.size(); ++i)
    ASSERT_TRUE(f.add_odometry(0.02 * static_cast<double>(i), way[i]));
  rt::Random random(5);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  constexpr int kDraws = 20000;
  for (int n = 0; n < kDraws; ++n) {
    const double a = 0.02 * random.normal(), b = 0.02 * random.normal(),
                 d = kDegree * random.normal(), r = 0.03 * random.normal();
    Pose2 X = way.front();
    for (std::size_t i = 1; i < way.size(); ++i) {
      const Pose2 s = compose(inverse(way[i - 1]), way[i]);
      const double length = std::hypot(s.x, s.y);
      X = compose(
          X, {s.x * (1 + a) - s.y * b, s.y * (1 + a) + s.x * b, s.yaw + d * length + r * s.yaw});
    }
    const Eigen::Vector3d e(X.x - way.back().x, X.y - way.back().y,
                            perception::wrap_angle(X.yaw - way.back().yaw));
    sum += e * e.transpose();
  }
  const Eigen::Matrix3d drawn = sum / kDraws;
  Eigen::Matrix3d stated = f.covariance();
  stated -= Eigen::Vector3d(25e-6, 25e-6, std::pow(0.3 * kDegree, 2)).asDiagonal();
  const double scale = drawn.trace();
  EXPECT_LT((stated - drawn).cwiseAbs().maxCoeff(), 0.05 * scale) << stated << "\n\n" << drawn;
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(stated(i, i) / drawn(i, i), 1, 0.06) << i;
}

// A drive with camera poses that come late: odometry with drawn shares for each leg between two of
// them.
struct Drive {
  WorldFilterConfig c;
  std::vector<Pose2> odometry;  // every 0.1 s
  std::vector<std::pair<double, Pose2>> camera;
  std::vector<Eigen::Vector4d> shares;
  std::vector<Pose2> truth;
  explicit Drive(std::uint64_t seed, int legs = 12, int steps = 5) {
    c.odometry_translation_share = 0.04;
    c.odometry_rotation_share = 0.02;
    c.odometry_deg_per_m = 1.5;
    rt::Random random(seed);
    Pose2 O, W;
    odometry.push_back(O);
    truth.push_back(W);
    for (int l = 0; l < legs; ++l) {
      const Eigen::Vector4d b(0.04 * random.normal(), 0.04 * random.normal(),
                              1.5 * kDegree * random.normal(), 0.02 * random.normal());
      const perception::Twist2 v{random.uniform(-0.4, 0.5), random.uniform(-0.2, 0.2),
                                 random.uniform(-0.6, 0.6)};
      for (int s = 0; s < steps; ++s) {
        const Pose2 step = perception::exp_se2({0.1 * v.vx, 0.1 * v.vy, 0.1 * v.wz});
        const double way = std::hypot(step.x, step.y);
        O = compose(O, step);
        W = compose(W, {step.x * (1 + b[0]) - step.y * b[1], step.y * (1 + b[0]) + step.x * b[1],
                        step.yaw * (1 + b[3]) + b[2] * way});
        odometry.push_back(O);
        truth.push_back(W);
      }
      camera.emplace_back(0.1 * static_cast<double>(odometry.size() - 1),
                          Pose2{W.x + 0.005 * random.normal(), W.y + 0.005 * random.normal(),
                                W.yaw + 0.3 * kDegree * random.normal()});
    }
  }
  // `late`: samples of odometry that are there before a camera pose comes.
  [[nodiscard]] WorldFilter run(int late) const {
    WorldFilter f(c, true);
    std::size_t next = 0;
    for (std::size_t i = 0; i < odometry.size() + static_cast<std::size_t>(late); ++i) {
      if (i < odometry.size()) f.add_odometry(0.1 * static_cast<double>(i), odometry[i]);
      while (next < camera.size() &&
             camera[next].first <= 0.1 * (static_cast<double>(i) - late) + 1e-9) {
        EXPECT_EQ(f.add_camera(camera[next].first, camera[next].second), Taken::kUsed);
        ++next;
      }
    }
    EXPECT_EQ(next, camera.size());
    return f;
  }
};

// All shares of all legs at once, by Gauss-Newton with numerical derivatives: least squares of the
// camera's residuals and the shares, each over its stated error. Its last pose and that pose's
// covariance.
std::pair<Pose2, Eigen::Matrix3d> batch(const Drive& d, int steps = 5) {
  const int legs = static_cast<int>(d.camera.size()), n = 4 * legs;
  const Eigen::Vector4d sigma(0.04, 0.04, 1.5 * kDegree, 0.02);
  const Eigen::Vector3d camera(0.005, 0.005, 0.3 * kDegree);
  const auto poses = [&](const Eigen::VectorXd& b) {
    std::vector<Pose2> at;
    Pose2 W;
    for (int l = 0; l < legs; ++l) {
      for (int s = 0; s < steps; ++s) {
        const auto i = static_cast<std::size_t>(l * steps + s);
        const Pose2 step = compose(inverse(d.odometry[i]), d.odometry[i + 1]);
        const double way = std::hypot(step.x, step.y);
        W = compose(W, {step.x * (1 + b[4 * l]) - step.y * b[4 * l + 1],
                        step.y * (1 + b[4 * l]) + step.x * b[4 * l + 1],
                        step.yaw * (1 + b[4 * l + 3]) + b[4 * l + 2] * way});
      }
      at.push_back(W);
    }
    return at;
  };
  const auto residuals = [&](const Eigen::VectorXd& b) {
    Eigen::VectorXd r(n + 3 * legs);
    for (int i = 0; i < n; ++i) r[i] = b[i] / sigma[i % 4];
    const auto at = poses(b);
    for (int l = 0; l < legs; ++l) {
      const Pose2 &z = d.camera[static_cast<std::size_t>(l)].second,
                  &p = at[static_cast<std::size_t>(l)];
      r.segment<3>(n + 3 * l) =
          Eigen::Vector3d(p.x - z.x, p.y - z.y, perception::wrap_angle(p.yaw - z.yaw))
              .cwiseQuotient(camera);
    }
    return r;
  };
  const auto last = [&](const Eigen::VectorXd& b) {
    const Pose2 p = poses(b).back();
    return Eigen::Vector3d(p.x, p.y, p.yaw);
  };
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd A(n + 3 * legs, n), L(3, n);
  for (int it = 0; it < 8; ++it) {
    const Eigen::VectorXd r = residuals(b);
    for (int i = 0; i < n; ++i) {
      Eigen::VectorXd p = b, m = b;
      p[i] += 1e-6, m[i] -= 1e-6;
      A.col(i) = (residuals(p) - residuals(m)) / 2e-6;
      L.col(i) = (last(p) - last(m)) / 2e-6;
    }
    b -= (A.transpose() * A).ldlt().solve(A.transpose() * r);
  }
  const Eigen::Vector3d p = last(b);
  const Eigen::MatrixXd inverse_normal = (A.transpose() * A).inverse();
  return {{p.x(), p.y(), p.z()}, L * inverse_normal * L.transpose()};
}

TEST(WorldFilter, TheBestPoseAndItsCovarianceAsInOneLeastSquaresOverAll) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Drive d(seed);
    const auto [X, P] = batch(d);
    const WorldFilter f = d.run(0);
    const Pose2 mine = compose(f.X_WO(), d.odometry.back());
    EXPECT_NEAR(mine.x, X.x, 3e-4) << "seed " << seed;
    EXPECT_NEAR(mine.y, X.y, 3e-4) << "seed " << seed;
    EXPECT_NEAR(perception::wrap_angle(mine.yaw - X.yaw), 0, 3e-4) << "seed " << seed;
    Eigen::Matrix3d stated = f.covariance();
    stated -= Eigen::Vector3d(25e-6, 25e-6, std::pow(0.3 * kDegree, 2)).asDiagonal();
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(stated(i, i) / P(i, i), 1, 0.05) << "seed " << seed;
  }
}

// The same poses, late by up to a second of driving: nothing is lost by that.
TEST(WorldFilter, ALatePoseCountsAtItsExposure) {
  const Drive d(3);
  const WorldFilter now = d.run(0);
  for (const int late : {1, 4, 10}) {
    const WorldFilter f = d.run(late);
    EXPECT_NEAR(f.X_WO().x, now.X_WO().x, 1e-12);
    EXPECT_NEAR(f.X_WO().yaw, now.X_WO().yaw, 1e-12);
    EXPECT_NEAR(f.error_m(), now.error_m(), 1e-12);
  }
}

TEST(WorldFilter, APoseBetweenTwoSamplesIsOnTheArcBetweenThem) {
  WorldFilter f(WorldFilterConfig{}, true);
  const perception::Twist2 v{0.5, 0.1, 0.7};
  ASSERT_TRUE(f.add_odometry(0, {}));
  ASSERT_TRUE(f.add_odometry(0.1, perception::integrate({}, v, 0.1)));
  EXPECT_EQ(f.add_camera(0.04, perception::integrate({}, v, 0.04)), Taken::kUsed);
  EXPECT_NEAR(std::hypot(f.X_WO().x, f.X_WO().y), 0, 1e-12);
  EXPECT_NEAR(f.X_WO().yaw, 0, 1e-12);
}

// Who loses the camera after a metre stands wrong by what the wheels slipped; it is found again by
// its covariance, in one pose, where a fixed gate of half a metre had locked it out.
TEST(WorldFilter, FoundAgainFarOff) {
  WorldFilterConfig c;
  c.odometry_translation_share = 0.065;
  c.odometry_deg_per_m = 2.2;
  WorldFilter f(c, true);
  for (int i = 0; i <= 200; ++i) ASSERT_TRUE(f.add_odometry(0.1 * i, {0.05 * i, 0, 0}));
  EXPECT_GT(f.error_m(), 1.5);
  EXPECT_EQ(f.add_camera(20.0, {9.3, 0.8, 0.15}), Taken::kUsed);
  EXPECT_NEAR(compose(f.X_WO(), {10, 0, 0}).x, 9.3, 0.005);
  EXPECT_LT(f.error_m(), 0.03);
}

TEST(WorldFilter, OneWrongPoseIsRefusedAndSeenSomeThatAgreeAreBelieved) {
  WorldFilterConfig c;
  WorldFilter f(c, true);
  double t = 0;
  const auto drive = [&](int n) {
    for (int i = 0; i < n; ++i) {
      t += 0.1;
      ASSERT_TRUE(f.add_odometry(t, {0.5 * t, 0, 0}));
    }
  };
  ASSERT_TRUE(f.add_odometry(0, {}));
  drive(5);
  EXPECT_EQ(f.add_camera(t, {0.5 * t, 0, 0}), Taken::kUsed);
  const double before = f.error_m();
  drive(1);
  EXPECT_EQ(f.add_camera(t, {0.5 * t, 1.2, 0}), Taken::kRefused);
  EXPECT_GT(f.error_m(), 1.2) << "while it is not known who is right";
  drive(1);
  EXPECT_EQ(f.add_camera(t, {0.5 * t, 0, 0}), Taken::kUsed);
  EXPECT_LT(f.error_m(), before + 0.01);
  EXPECT_EQ(f.refused_in_a_row(), 0);
  // Wrong ones that do not agree are never believed.
  rt::Random random(1);
  for (int i = 0; i < 40; ++i) {
    drive(1);
    EXPECT_EQ(
        f.add_camera(t, {random.uniform(2, 50), random.uniform(2, 50), random.uniform(-3, 3)}),
        Taken::kRefused);
    EXPECT_LT(f.refused_in_a_row(), 3);
  }
  // It was carried a metre aside: five poses that agree.
  for (int i = 0; i < 5; ++i) {
    drive(1);
    EXPECT_EQ(f.add_camera(t, {0.5 * t + 0.3, 1, 0.2}),
              i < 4 ? Taken::kRefused : Taken::kRestarted);
  }
  EXPECT_NEAR(compose(f.X_WO(), {0.5 * t, 0, 0}).y, 1, 1e-9);
  EXPECT_LT(f.error_m(), 0.03);
}

TEST(WorldFilter, WithoutAStartNothingIsKnownUntilAPoseIsClaimed) {
  WorldFilter f(WorldFilterConfig{}, false);
  EXPECT_FALSE(f.known());
  EXPECT_EQ(f.add_camera(0, {1, 2, 3}), Taken::kTooNew) << "no odometry yet";
  ASSERT_TRUE(f.add_odometry(0, {5, 5, 1}));
  ASSERT_TRUE(f.add_odometry(0.1, {5.01, 5, 1}));
  EXPECT_GT(f.error_m(), 1000);
  EXPECT_EQ(f.add_camera(0.1, {1, 2, -3}), Taken::kUsed);
  EXPECT_TRUE(f.known());
  const Pose2 X = compose(f.X_WO(), {5.01, 5, 1});
  EXPECT_NEAR(X.x, 1, 1e-6);
  EXPECT_NEAR(X.y, 2, 1e-6);
  EXPECT_NEAR(X.yaw, -3, 1e-5);
  EXPECT_LT(f.error_m(), 0.03);
  f.restart_odometry();
  EXPECT_FALSE(f.known());
  ASSERT_TRUE(f.add_odometry(3, {}));
  EXPECT_EQ(f.add_camera(3, {1, 2, 3}), Taken::kUsed);
  EXPECT_NEAR(compose(f.X_WO(), {}).y, 2, 1e-6);
}

TEST(WorldFilter, BadOldAndEarlyInput) {
  WorldFilter f(WorldFilterConfig{}, true);
  ASSERT_TRUE(f.add_odometry(1, {}));
  EXPECT_FALSE(f.add_odometry(1, {1, 0, 0}));
  EXPECT_FALSE(f.add_odometry(0.5, {1, 0, 0}));
  EXPECT_FALSE(f.add_odometry(2, {std::nan(""), 0, 0}));
  ASSERT_TRUE(f.add_odometry(2, {}));
  EXPECT_EQ(f.add_camera(1.5, {std::nan(""), 0, 0}), Taken::kRefused);
  EXPECT_EQ(f.add_camera(2.1, {}), Taken::kTooNew);
  EXPECT_EQ(f.add_camera(0.9, {}), Taken::kTooOld);
  EXPECT_EQ(f.add_camera(1.5, {}), Taken::kUsed);
  EXPECT_EQ(f.add_camera(1.5, {}), Taken::kTooOld) << "twice";
  EXPECT_EQ(f.add_camera(1.4, {}), Taken::kTooOld);
}

// Wheels that slip by 0 to 10 % each, drawn anew every half second, of a radius 1 % off, with 4000
// ticks: what a scene with them states of its odometry covers what it does, and not by a multiple.
// One metre to six, ahead, aside and turning, no camera; 0.065, 0.065, 2.2 deg/m are the root mean
// squares that the slips' distribution gives (docs/prediction.md).
TEST(WorldFilter, StatedErrorOfSlippingWheelsCoversThem) {
  rt::Startup startup;
  WorldFilterConfig c;
  c.odometry_translation_share = c.odometry_rotation_share = 0.065;
  c.odometry_deg_per_m = 2.2;
  int over = 0;
  double sum2 = 0, most = 0;
  constexpr int kSeeds = 300;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    drivers::RobotPlantConfig p;
    p.speed_loop_order = 0;
    p.substep_us = 1000;
    p.wheel_slip_max = 0.1;
    p.wheel_slip_seed = static_cast<std::uint64_t>(seed);
    p.wheel_radius_error.fill(-0.01);
    p.encoder_ticks_per_motor_turn = 4000;
    drivers::RobotPlant plant(startup.token(), p, {}, {});
    drivers::Odometry odometry{drivers::Mecanum()};
    WorldFilter f(c, true);
    rt::Random random(1000 + static_cast<std::uint64_t>(seed));
    const rt::Time start = rt::time_from_ns(1'000'000'000);
    plant.advance(start);
    const int tenths = static_cast<int>(random.integer(20, 120));
    perception::Twist2 v;
    for (int i = 0; i <= tenths; ++i) {
      const rt::Time now = start + i * std::chrono::milliseconds{100};
      plant.advance(now);
      ASSERT_TRUE(odometry.update(plant.encoder_rad()));
      ASSERT_TRUE(f.add_odometry(0.1 * i, odometry.pose()));
      if (i % 10 == 0)
        v = {random.uniform(-0.3, 0.5), random.uniform(-0.3, 0.3), random.uniform(-0.6, 0.6)};
      plant.command(now, plant.kinematics().inverse(v), true);
    }
    const Pose2& X = plant.state().X_WB;
    const double off = std::hypot(X.x - odometry.pose().x, X.y - odometry.pose().y);
    const double share = off / f.error_m();
    over += share > 1 ? 1 : 0;
    sum2 += share * share;
    most = std::max(most, share);
  }
  std::printf("  error over the stated one: %.2f RMS, %.2f at most, above 1 in %d of %d\n",
              std::sqrt(sum2 / kSeeds), most, over, kSeeds);
  EXPECT_EQ(over, 0);
  EXPECT_GT(most, 0.3) << "it says more than that it is not infinite";
}

// No allocation, no lock, nothing that throws.
TEST(WorldFilter, IsRealTime) {
  WorldFilter f(WorldFilterConfig{}, true);
  rt::Section section;
  for (int i = 0; i < 1000; ++i) {
    (void)f.add_odometry(0.1 * i, {0.05 * i, 0, 0});
    (void)f.add_camera(0.1 * i - 0.05, {0.05 * i, 0, 0});
  }
}

}  // namespace
