// Where odometry alone has the camera.
#include <gtest/gtest.h>

#include <numbers>

#include "rt/random.hpp"
#include "tasks/fusion/odometry_chain.hpp"

namespace tasks {
namespace {

using perception::Vec3;

constexpr double kDegree = std::numbers::pi / 180;

Pose moved(double x_m, double turn_deg = 0) {
  Pose X = Pose::Identity();
  X.translation().x() = x_m;
  X.linear() = Eigen::AngleAxisd(turn_deg * kDegree, Vec3::UnitZ()).toRotationMatrix();
  return X;
}

// Steps that are off by less than the stated share: it is where the claims are.
TEST(OdometryChain, FollowsClaimsWithinTheStatedError) {
  constexpr double kShare = 0.05;
  rt::Random random(4);
  OdometryChain chain;
  Pose X_WC = Pose::Identity();
  chain.restart(X_WC);
  for (int i = 0; i < 300; ++i) {
    const double way = 0.02 * random.uniform(), turn = random.uniform();
    X_WC = X_WC * moved(way, turn);
    const double off = 1 + kShare * (2 * random.uniform() - 1);
    chain.carry(moved(off * way, off * turn), kShare * way, kShare * turn);
    chain.follow(X_WC);
    EXPECT_LT((chain.X_WC().translation() - X_WC.translation()).norm(), 1e-9) << i;
  }
}

// A camera that stands, and claims that creep by 2 mm a frame: what adds up is seen.
TEST(OdometryChain, KeepsTheSumOfSmallSteps) {
  OdometryChain chain;
  double most_m = 0;
  for (int i = 1; i <= 8; ++i) {
    chain.carry(moved(0), 0, 0);
    chain.follow(moved(0.002 * i));
    most_m = std::max(most_m, 0.002 * i - chain.X_WC().translation().x());
  }
  EXPECT_GT(most_m, 0.008);
  // Noise of a camera that stands is none.
  OdometryChain still;
  rt::Random random(5);
  for (int i = 0; i < 200; ++i) {
    still.carry(moved(0), 0, 0);
    still.follow(moved(0.0003 * random.normal()));
    EXPECT_LT(std::abs(still.X_WC().translation().x()), 0.0015) << i;
  }
}

// Far from the claims for whatever reason: it starts anew, and without a claim it goes on alone.
TEST(OdometryChain, GivesUpAndStartsAnew) {
  OdometryChain chain;
  chain.carry(moved(0.1), 0, 0);
  EXPECT_NEAR(chain.X_WC().translation().x(), 0.1, 1e-12);
  chain.follow(moved(0.1 + 1.1 * OdometryChain::kGivenUp_m));
  EXPECT_NEAR(chain.X_WC().translation().x(), 0.1 + 1.1 * OdometryChain::kGivenUp_m, 1e-12);
  chain.follow(moved(0.122, 1.1 * OdometryChain::kGivenUp_deg));
  EXPECT_NEAR(Eigen::AngleAxisd(chain.X_WC().linear()).angle() / kDegree,
              1.1 * OdometryChain::kGivenUp_deg, 1e-9);
}

}  // namespace
}  // namespace tasks
