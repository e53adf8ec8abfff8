#include "drivers/falcon/falcon_kinematics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "drivers/falcon/falcon_device.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using drivers::FalconKinematics;
using perception::Mat3;
using perception::Vec3;

constexpr double kA = 0.060, kB = 0.1025, kC = 0.014, kD = 0.01125, kF = -0.025, kR = 0.037233758,
                 kS = -0.027330909;

double phi(int leg) {
  constexpr double pi = std::numbers::pi;
  return std::array{pi / 2, -pi / 6, -5 * pi / 6}[static_cast<std::size_t>(leg)] + pi / 12;
}

Vec3 in_workspace(rt::Random& random, double radius = 0.05) {
  while (true) {
    const Vec3 d(random.uniform(-radius, radius), random.uniform(-radius, radius),
                 random.uniform(-radius, radius));
    if (d.norm() <= radius) return Vec3(0, 0, FalconKinematics::kCentreZ_m) + d;
  }
}

// How far a leg is from closing: walks from the base over thigh, joint, shin and joint to the
// plate, with the two angles that the wanted end leaves open found from the ends, not from the
// solution.
double gap(int leg, const Vec3& p, double theta1) {
  const double c = std::cos(phi(leg)), s = std::sin(phi(leg));
  const Vec3 knee_uvw(kR + kA * std::cos(theta1), 0, kA * std::sin(theta1));
  const Vec3 plate_uvw(c * p.x() + s * p.y() + kC, -s * p.x() + c * p.y() - kS + kF, p.z());
  const Vec3 shin = plate_uvw - knee_uvw;
  // Both joints of d = e lie along the shin's direction in the leg's plane.
  const double in_plane = std::hypot(shin.x(), shin.z()) - 2 * kD;
  return std::hypot(in_plane, shin.y()) - kB;
}

TEST(FalconKinematics, InverseClosesEveryLeg) {
  const std::uint64_t seed = 511;
  rt::Random random(seed);
  for (int i = 0; i < 5000; ++i) {
    const Vec3 p = in_workspace(random);
    Vec3 theta;
    ASSERT_TRUE(FalconKinematics::inverse(p, theta)) << p.transpose();
    for (int leg = 0; leg < 3; ++leg) {
      ASSERT_NEAR(gap(leg, p, theta[leg]), 0, 1e-13) << "seed " << seed;
    }
  }
}

// The root that the published driver takes (half-angle form), written out from its closed form.
TEST(FalconKinematics, SameBranchAsThePublishedDriver) {
  const std::uint64_t seed = 512;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 p = in_workspace(random);
    Vec3 theta;
    ASSERT_TRUE(FalconKinematics::inverse(p, theta));
    for (int leg = 0; leg < 3; ++leg) {
      const double u = std::cos(phi(leg)) * p.x() + std::sin(phi(leg)) * p.y() - kR;
      const double v = -std::sin(phi(leg)) * p.x() + std::cos(phi(leg)) * p.y() - kS + kF;
      const double w = p.z(), L = 2 * kD + std::sqrt(kB * kB - v * v);
      const double same = w * w + u * u + 2 * kC * u + kA * kA + kC * kC - L * L;
      const double l0 = same - 2 * kA * (u + kC), l2 = same + 2 * kA * (u + kC), l1 = -4 * kA * w;
      const double t = (-l1 - std::sqrt(l1 * l1 - 4 * l0 * l2)) / (2 * l2);
      ASSERT_NEAR(theta[leg], 2 * std::atan(t), 1e-9) << "seed " << seed;
    }
  }
}

TEST(FalconKinematics, ForwardResidualBelowAMicroradian) {
  const std::uint64_t seed = 513;
  rt::Random random(seed);
  double worst_rad = 0, worst_m = 0;
  int most = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3 p = in_workspace(random);
    Vec3 theta;
    ASSERT_TRUE(FalconKinematics::inverse(p, theta));
    // From anywhere in the workspace, as after a homing.
    const auto far = FalconKinematics::forward(theta, in_workspace(random));
    ASSERT_TRUE(far.good) << p.transpose() << " seed " << seed;
    // And from where the hand was a tick ago.
    const auto near = FalconKinematics::forward(
        theta,
        p + Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)) * 1e-3);
    Vec3 back;
    ASSERT_TRUE(FalconKinematics::inverse(near.p_F, back));
    worst_rad = std::max({worst_rad, (back - theta).cwiseAbs().maxCoeff(), far.residual_rad});
    worst_m = std::max({worst_m, (near.p_F - p).norm(), (far.p_F - p).norm()});
    most = std::max(most, near.iterations);
  }
  EXPECT_LE(worst_rad, 1e-6);
  EXPECT_LE(worst_rad, 1e-9);  // what it really reaches
  EXPECT_LE(worst_m, 1e-9);
  EXPECT_LE(most, 5);
  std::printf("forward: residual %.1e rad, position %.1e m, at most %d iterations after 1 mm\n",
              worst_rad, worst_m, most);
}

TEST(FalconKinematics, JacobianAgainstDifferences) {
  const std::uint64_t seed = 514;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 p = in_workspace(random, 0.045);
    Vec3 theta;
    Mat3 J;
    ASSERT_TRUE(FalconKinematics::inverse(p, theta));
    ASSERT_TRUE(FalconKinematics::jacobian(p, theta, J));
    constexpr double h = 1e-6;
    for (int k = 0; k < 3; ++k) {
      Vec3 a, b, step = Vec3::Zero();
      step[k] = h;
      ASSERT_TRUE(FalconKinematics::inverse(p + step, a));
      ASSERT_TRUE(FalconKinematics::inverse(p - step, b));
      const Vec3 difference = (a - b) / (2 * h);
      ASSERT_LT((J.col(k) - difference).norm(), 1e-5 * (1 + difference.norm())) << "seed " << seed;
    }
  }
}

// The torques do the work of the force: tau . dtheta = f . dp, by finite motions of the mechanism.
TEST(FalconKinematics, TorqueDoesTheWorkOfTheForce) {
  const std::uint64_t seed = 515;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 p = in_workspace(random, 0.045);
    const auto any = [&] {
      return Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    };
    const Vec3 f = 8 * any(), dp = 1e-6 * any();
    Vec3 theta, a, b, tau;
    Mat3 J;
    ASSERT_TRUE(FalconKinematics::inverse(p, theta));
    ASSERT_TRUE(FalconKinematics::jacobian(p, theta, J));
    ASSERT_TRUE(FalconKinematics::torque(J, f, tau));
    ASSERT_TRUE(FalconKinematics::inverse(p + dp, a));
    ASSERT_TRUE(FalconKinematics::inverse(p - dp, b));
    const double work = tau.dot(a - b);
    ASSERT_NEAR(work, 2 * f.dot(dp), 1e-5 * f.norm() * dp.norm()) << "seed " << seed;
  }
}

TEST(FalconKinematics, OutOfReachIsRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Vec3 theta(1, 2, 3);
  for (const Vec3& p : {Vec3(0, 0, 0.5), Vec3(0.3, 0, 0.1), Vec3(0, 0, 0.03), Vec3(nan, 0, 0.1)}) {
    EXPECT_FALSE(FalconKinematics::inverse(p, theta)) << p.transpose();
    EXPECT_EQ(theta, Vec3(1, 2, 3));
  }
  const Vec3 centre(0, 0, FalconKinematics::kCentreZ_m);
  EXPECT_FALSE(FalconKinematics::forward(Vec3(nan, 0, 0), centre).good);
}

// Any angles, any start: bounded, and "good" is never said of a wrong answer.
TEST(FalconKinematics, AnyAnglesEndAndNeverLie) {
  const std::uint64_t seed = 516;
  rt::Random random(seed);
  int solved = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3 theta(random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3));
    const auto r = FalconKinematics::forward(theta, in_workspace(random));
    ASSERT_LE(r.iterations, FalconKinematics::kMaxIterations);
    if (!r.good) continue;
    ++solved;
    Vec3 back;
    ASSERT_TRUE(FalconKinematics::inverse(r.p_F, back));
    ASSERT_LE((back - theta).cwiseAbs().maxCoeff(), 1e-6) << "seed " << seed;
  }
  EXPECT_GT(solved, 1000);
  EXPECT_LT(solved, 19000);  // most triples of angles belong to no position
}

TEST(FalconKinematics, FramesAndBack) {
  rt::Random random(517);
  for (int i = 0; i < 100; ++i) {
    const Vec3 p = in_workspace(random);
    EXPECT_LT((drivers::FalconDevice::to_F(drivers::FalconDevice::to_D(p)) - p).norm(), 1e-15);
  }
  using drivers::FalconDevice;
  EXPECT_EQ(FalconDevice::direction_to_F({1, 0, 0}), Vec3(0, 0, -1));  // away from the operator
  EXPECT_EQ(FalconDevice::direction_to_F({0, 1, 0}), Vec3(-1, 0, 0));  // left
  EXPECT_EQ(FalconDevice::direction_to_F({0, 0, 1}), Vec3(0, 1, 0));   // up
}

TEST(FalconKinematics, NothingIsAllocated) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  Vec3 theta, tau;
  Mat3 J;
  const Vec3 p(0.01, 0.02, 0.12);
  (void)FalconKinematics::inverse(p, theta);
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 100; ++i) {
      const auto r = FalconKinematics::forward(theta, Vec3(0, 0, 0.12));
      (void)FalconKinematics::jacobian(r.p_F, theta, J);
      (void)FalconKinematics::torque(J, Vec3(1, 2, 3), tau);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
