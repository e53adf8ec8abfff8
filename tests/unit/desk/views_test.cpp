// What the page's views are made of.
#include <gtest/gtest.h>

#include "rt/random.hpp"
#include "tools/desk/desk_views.hpp"

namespace {

using perception::Pose;
using perception::Pose2;
using perception::Twist2;

Pose in_space(const Pose2& p) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(p.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  X.translation() << p.x, p.y, 0;
  return X;
}

// A camera that is bolted to the base, which drives an arc: its place on the base does not change,
// whichever place of the arc the base is told to be at.
TEST(DeskViews, ACameraIsCarriedAsItsBaseDrives) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    rt::Random random(seed);
    const auto in = [&](double lo, double hi) { return lo + (hi - lo) * random.uniform(); };
    const Pose2 base{in(-5, 5), in(-5, 5), in(-3, 3)};
    const Twist2 v{in(-0.8, 0.8), in(-0.8, 0.8), in(-1.2, 1.2)};
    const double s = in(-0.2, 0.2), told_later_s = in(-0.5, 0.5);
    Pose X_BC = Pose::Identity();
    X_BC.translate(Eigen::Vector3d(in(-1, 1), in(-1, 1), in(0, 1)));
    X_BC.rotate(Eigen::Quaterniond(in(0.1, 1), in(-1, 1), in(-1, 1), in(-1, 1)).normalized());
    const Pose before = in_space(base) * X_BC;
    const Pose after = in_space(perception::integrate(base, v, s)) * X_BC;
    const Pose got = teletact::carried(before, perception::integrate(base, v, told_later_s), v, s);
    EXPECT_LT((got.matrix() - after.matrix()).norm(), 1e-9) << "seed " << seed;
  }
}

TEST(DeskViews, ABaseThatStandsCarriesNothing) {
  Pose X = Pose::Identity();
  X.translate(Eigen::Vector3d(1, 2, 3));
  EXPECT_LT((teletact::carried(X, {4, 5, 1}, {}, 0.1).matrix() - X.matrix()).norm(), 1e-12);
}

}  // namespace
