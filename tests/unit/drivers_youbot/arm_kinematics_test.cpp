// The arm's kinematics against the description's chain of frames, multiplied out, and against a
// search.
#include "drivers/youbot/arm_kinematics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "rt/random.hpp"

namespace {

using drivers::ArmAngles;
using perception::Pose;

constexpr double kDeg = std::numbers::pi / 180;
const drivers::ArmLimits kLimits;

// A 4 x 4 matrix by rows, with nothing of the tested code in it.
using Matrix = std::array<double, 16>;
Matrix times(const Matrix& a, const Matrix& b) {
  Matrix out{};
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c)
      for (int k = 0; k < 4; ++k) out[4 * r + c] += a[4 * r + k] * b[4 * k + c];
  return out;
}
Matrix shift(double x, double y, double z) {
  return {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1};
}
Matrix about_y(double a) {
  return {std::cos(a), 0, std::sin(a), 0, 0, 1, 0, 0, -std::sin(a), 0, std::cos(a), 0, 0, 0, 0, 1};
}
Matrix about_z(double a) {
  return {std::cos(a), -std::sin(a), 0, 0, std::sin(a), std::cos(a), 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
}
// arm.urdf.xacro, joint after joint: origin, then rotation about the axis.
Matrix chain(const ArmAngles& q) {
  Matrix m = times(times(shift(0.024, 0, 0.096), about_z(170 * kDeg)), about_z(-q[0]));
  m = times(m, times(times(shift(0.033, 0, 0.019), about_y(-65 * kDeg)), about_y(q[1])));
  m = times(m, times(times(shift(0, 0, 0.155), about_y(146 * kDeg)), about_y(q[2])));
  m = times(m, times(times(shift(0, 0, 0.135), about_y(-102.5 * kDeg)), about_y(q[3])));
  return times(m, times(times(shift(-0.002, 0, 0.130), about_z(167.5 * kDeg)), about_z(-q[4])));
}
double apart(const Matrix& a, const Pose& X) {
  double most = 0;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c) most = std::max(most, std::abs(a[4 * r + c] - X.matrix()(r, c)));
  return most;
}
double apart(const ArmAngles& a, const ArmAngles& b) {
  double most = 0;
  for (std::size_t j = 0; j < a.size(); ++j) most = std::max(most, std::abs(a[j] - b[j]));
  return most;
}
ArmAngles any(rt::Random& random) {
  ArmAngles q{};
  for (std::size_t j = 0; j < q.size(); ++j) q[j] = random.uniform(kLimits.low[j], kLimits.high[j]);
  return q;
}

// How many q give the pose: joint 1 by a scan for where the palm lies in the plane, joint 2 by a
// scan for where the elbow is a forearm away from the wrist. Roots by bisection, the rest follows.
int search(const Matrix& m) {
  const auto root = [](auto f, double low, double high) {
    double at_low = f(low);
    for (int i = 0; i < 60; ++i) {
      const double middle = (low + high) / 2, v = f(middle);
      if ((v > 0) == (at_low > 0)) {
        low = middle;
        at_low = v;
      } else {
        high = middle;
      }
    }
    return (low + high) / 2;
  };
  const auto in = [](double angle, std::size_t j) {
    for (int k = -2; k <= 2; ++k) {
      const double a = angle + 2 * std::numbers::pi * k;
      if (a >= kLimits.low[j] && a <= kLimits.high[j]) return true;
    }
    return false;
  };
  int found = 0;
  const auto off_plane = [&](double q1) {
    const double a = 170 * kDeg - q1;
    return std::cos(a) * m[7] - std::sin(a) * (m[3] - 0.024);
  };
  for (int i = 0; i < 600; ++i) {
    const double from = 5.8992 * i / 600, to = 5.8992 * (i + 1) / 600;
    if ((off_plane(from) > 0) == (off_plane(to) > 0)) continue;
    const double q1 = root(off_plane, from, to), a = 170 * kDeg - q1;
    // Into the plane: position and axis of the palm.
    const double x = std::cos(a) * (m[3] - 0.024) + std::sin(a) * m[7] - 0.033;
    const double z = m[11] - 0.096 - 0.019;
    const double ax = std::cos(a) * m[2] + std::sin(a) * m[6], az = m[10];
    const double wx = x - 0.130 * ax + 0.002 * az, wz = z - 0.130 * az - 0.002 * ax;
    const auto too_far = [&](double q2) {
      const double e = q2 - 65 * kDeg;
      return std::hypot(wx - 0.155 * std::sin(e), wz - 0.155 * std::cos(e)) - 0.135;
    };
    for (int k = 0; k < 2000; ++k) {
      const double f2 = 2.7053 * k / 2000, t2 = 2.7053 * (k + 1) / 2000;
      if ((too_far(f2) > 0) == (too_far(t2) > 0)) continue;
      const double e = root(too_far, f2, t2) - 65 * kDeg;
      const double fore = std::atan2(wx - 0.155 * std::sin(e), wz - 0.155 * std::cos(e));
      const double tilt = std::atan2(ax, az);
      // Roll: the palm's x axis, out of the plane.
      const Matrix r = times(about_y(-tilt), times(about_z(-a), m));
      const double roll = std::atan2(r[4], r[0]);
      if (in(fore - e - 146 * kDeg, 2) && in(tilt - fore + 102.5 * kDeg, 3) &&
          in(167.5 * kDeg - roll, 4))
        ++found;
    }
  }
  return found;
}

TEST(ArmKinematics, ForwardIsTheDescriptionsChain) {
  rt::Random random(5);
  double worst = 0;
  for (int i = 0; i < 100000; ++i) {
    const ArmAngles q = any(random);
    worst = std::max(worst, apart(chain(q), drivers::arm_forward(q)));
  }
  std::printf("worst %.3g\n", worst);
  EXPECT_LE(worst, 1e-12);
}

TEST(ArmKinematics, EveryBranchGivesThePoseAndOneGivesTheAngles) {
  constexpr std::uint64_t kSeed = 22;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  std::array<int, 5> counts{};
  for (int i = 0; i < 100000; ++i) {
    const ArmAngles q = any(random);
    const Pose X = drivers::arm_forward(q);
    const auto found = drivers::arm_inverse(X);
    ASSERT_GE(found.count, 1) << i;
    ++counts[static_cast<std::size_t>(found.count)];
    double nearest = 10;
    for (int k = 0; k < found.count; ++k) {
      const ArmAngles& s = found.q[static_cast<std::size_t>(k)];
      ASSERT_TRUE(kLimits.holds(s));
      ASSERT_LE(apart(chain(s), X), 1e-9) << i << " branch " << k;
      nearest = std::min(nearest, apart(s, q));
    }
    // Where the arm is straight, angles follow from a pose by the root of its error.
    const double fore = q[2] + 146 * kDeg;
    ASSERT_LE(nearest, std::abs(std::sin(fore)) > 1e-2 ? 1e-9 : 1e-6) << i;
  }
  std::printf("branches 1: %d, 2: %d, 3: %d, 4: %d\n", counts[1], counts[2], counts[3], counts[4]);
  EXPECT_GT(counts[2], 1000);
}

TEST(ArmKinematics, AsManyBranchesAsASearchFinds) {
  rt::Random random(7);
  int different = 0, several = 0;
  for (int i = 0; i < 2000; ++i) {
    const ArmAngles q = any(random);
    // Two roots within a step of the search are not told apart by it.
    if (std::abs(std::sin(q[2] + 146 * kDeg)) < 0.05) continue;
    const auto found = drivers::arm_inverse(drivers::arm_forward(q));
    several += found.count > 1 ? 1 : 0;
    const int searched = search(chain(q));
    if (found.count != searched) std::printf("pose %d: %d and %d\n", i, found.count, searched);
    different += found.count != searched ? 1 : 0;
  }
  EXPECT_EQ(different, 0);
  EXPECT_GT(several, 100);
}

// On the axis of joint 1, straight, and at the limits: finite, inside, and the pose.
TEST(ArmKinematics, SingularPosesStayBounded) {
  // Candle: straight up. The offset of joint 5 is all that is left of the arm's reach.
  const ArmAngles candle{169 * kDeg, 65 * kDeg, -146 * kDeg, 102.5 * kDeg, 167.5 * kDeg};
  for (const ArmAngles& q : {candle, ArmAngles{}, kLimits.low, kLimits.high}) {
    const Pose X = drivers::arm_forward(q);
    const auto found = drivers::arm_inverse(X);
    ASSERT_GE(found.count, 1);
    for (int k = 0; k < found.count; ++k) {
      EXPECT_TRUE(kLimits.holds(found.q[static_cast<std::size_t>(k)]));
      EXPECT_LE(apart(chain(found.q[static_cast<std::size_t>(k)]), X), 1e-7);
    }
  }
  // The palm on joint 1's axis, by the angles that bring it there.
  rt::Random random(3);
  int on_axis = 0;
  for (int i = 0; i < 100000 && on_axis < 20; ++i) {
    ArmAngles q = any(random);
    const auto reach = [&](double q2) {
      q[1] = q2;
      const Matrix m = chain({170 * kDeg, q[1], q[2], q[3], q[4]});
      return m[3] - 0.024;
    };
    double low = 0, high = 2.7;
    if ((reach(low) > 0) == (reach(high) > 0)) continue;
    for (int k = 0; k < 200; ++k)
      ((reach((low + high) / 2) > 0) == (reach(low) > 0) ? low : high) = (low + high) / 2;
    ++on_axis;
    const Pose X = drivers::arm_forward(q);
    const auto found = drivers::arm_inverse(X, kLimits, 1e-9);
    for (int k = 0; k < found.count; ++k) {
      const ArmAngles& s = found.q[static_cast<std::size_t>(k)];
      EXPECT_TRUE(kLimits.holds(s));
      EXPECT_LE(apart(chain(s), X), 1e-8);
    }
  }
  EXPECT_EQ(on_axis, 20);
}

TEST(ArmKinematics, WhatIsOutOfReachHasNoSolution) {
  Pose X = Pose::Identity();
  X.translation() = perception::Vec3(2, 0, 0);
  EXPECT_EQ(drivers::arm_inverse(X).count, 0);
  X.translation().x() = std::nan("");
  EXPECT_EQ(drivers::arm_inverse(X).count, 0);
  // An axis that leaves the plane.
  X = drivers::arm_forward({3, 1, -2, 1, 3});
  X.linear() = X.linear() * Eigen::AngleAxisd(0.01, perception::Vec3::UnitX()).toRotationMatrix();
  EXPECT_EQ(drivers::arm_inverse(X).count, 0);
}

}  // namespace
