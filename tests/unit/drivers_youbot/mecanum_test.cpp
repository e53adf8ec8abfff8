#include "drivers/youbot/mecanum.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "rt/random.hpp"
#include "tests/unit/drivers_youbot/disagreement.hpp"

namespace {

using drivers::Mecanum;
using drivers::MecanumConfig;
using drivers::Odometry;
using drivers::WheelVector;
using perception::Pose2;
using perception::Twist2;

TEST(Mecanum, ForwardUndoesInverseForEveryGeometry) {
  const std::uint64_t seed = 11;
  rt::Random random(seed);
  for (int i = 0; i < 2000; ++i) {
    MecanumConfig c;
    c.wheel_radius_m = random.uniform(0.02, 0.2);
    c.axle_distance_m = random.uniform(0.1, 1);
    c.track_width_m = random.uniform(0.1, 1);
    c.slide_ratio = random.uniform(0.5, 1.5);
    const Mecanum k(c);
    const Twist2 v{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-2, 2)};
    const WheelVector w = k.inverse(v);
    const Twist2 back = k.forward(w);
    EXPECT_NEAR(back.vx, v.vx, 1e-12) << "seed " << seed << " case " << i;
    EXPECT_NEAR(back.vy, v.vy, 1e-12) << "seed " << seed << " case " << i;
    EXPECT_NEAR(back.wz, v.wz, 1e-12) << "seed " << seed << " case " << i;
    EXPECT_NEAR(disagreement(w), 0, 1e-9);
    double peak = 0;
    for (const double s : w) peak = std::max(peak, std::abs(s));
    EXPECT_NEAR(k.peak_wheel_speed(v), peak, 1e-9);
  }
}

// A calibrated base is the one whose wheels, lever and slide are so.
TEST(Mecanum, CalibratedScalesAreThoseOfTheGeometry) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    rt::Random random(seed);
    MecanumConfig c;
    for (double& scale : c.wheel_scale) scale = random.uniform(0.8, 1.2);
    c.lever_scale = random.uniform(0.8, 1.2);
    c.slide_scale = random.uniform(0.8, 1.2);
    const Mecanum k(c);
    const Twist2 v{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-2, 2)};
    const Twist2 back = k.forward(k.inverse(v));
    EXPECT_NEAR(back.vx, v.vx, 1e-12) << "seed " << seed;
    EXPECT_NEAR(back.vy, v.vy, 1e-12) << "seed " << seed;
    EXPECT_NEAR(back.wz, v.wz, 1e-12) << "seed " << seed;
    // Each wheel by itself, from a base of that radius all round.
    WheelVector w{};
    Twist2 sum;
    for (int i = 0; i < 4; ++i) {
      MecanumConfig one = drivers::uncalibrated(c);
      one.wheel_radius_m *= c.wheel_scale[i];
      one.axle_distance_m *= c.lever_scale, one.track_width_m *= c.lever_scale;
      one.slide_ratio *= c.slide_scale;
      w[i] = random.uniform(-5, 5);
      WheelVector alone{};
      alone[i] = w[i];
      const Twist2 part = Mecanum(one).forward(alone);
      sum.vx += part.vx, sum.vy += part.vy, sum.wz += part.wz;
    }
    const Twist2 whole = k.forward(w);
    EXPECT_NEAR(whole.vx, sum.vx, 1e-12) << "seed " << seed;
    EXPECT_NEAR(whole.vy, sum.vy, 1e-12) << "seed " << seed;
    EXPECT_NEAR(whole.wz, sum.wz, 1e-12) << "seed " << seed;
    double peak = 0;
    for (const double s : k.inverse(v)) peak = std::max(peak, std::abs(s));
    EXPECT_GE(k.peak_wheel_speed(v), peak - 1e-9) << "seed " << seed;
  }
}

// Nothing calibrated: the bytes of the formulas without scales.
TEST(Mecanum, WithoutCalibrationNotABitDiffers) {
  const MecanumConfig c;
  const double r = c.wheel_radius_m, k = (c.axle_distance_m + c.track_width_m) / 2,
               s = c.slide_ratio;
  rt::Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const Twist2 v{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-2, 2)};
    const double y = v.vy / s, t = k * v.wz;
    EXPECT_EQ(Mecanum().inverse(v), (WheelVector{(-v.vx + y + t) / r, (v.vx + y + t) / r,
                                                 (-v.vx - y + t) / r, (v.vx - y + t) / r}));
    const WheelVector w{random.uniform(-9, 9), random.uniform(-9, 9), random.uniform(-9, 9),
                        random.uniform(-9, 9)};
    const double q = r / 4;
    EXPECT_EQ(Mecanum().forward(w),
              (Twist2{q * (-w[0] + w[1] - w[2] + w[3]), s * q * (w[0] + w[1] - w[2] - w[3]),
                      q / k * (w[0] + w[1] + w[2] + w[3])}));
  }
}

// Handy figures of the youBot reference: 1 m/s forward is 5194.4 motor rpm, 1 rad/s is 1999.8 rpm,
// one encoder tick (4000 a motor turn) rolls 2.888 um.
TEST(Mecanum, YoubotFigures) {
  const Mecanum k;
  const WheelVector forward = k.inverse({1, 0, 0});
  EXPECT_NEAR(k.motor_rpm(forward[1]), 5194.4, 0.05);
  EXPECT_NEAR(k.motor_rpm(forward[0]), -5194.4, 0.05);  // left wheels turn backward
  EXPECT_NEAR(k.motor_rpm(k.inverse({0, 0, 1})[0]), 1999.8, 0.05);
  const double tick = 2 * std::numbers::pi / 4000 / k.gear_ratio() * k.wheel_radius();
  EXPECT_NEAR(tick * 1e6, 2.888, 0.001);
}

TEST(Mecanum, SignsOfTheWiring) {
  const Mecanum k;
  const WheelVector left = k.inverse({0, 1, 0});
  EXPECT_GT(left[0], 0);
  EXPECT_GT(left[1], 0);
  EXPECT_LT(left[2], 0);
  EXPECT_LT(left[3], 0);
  for (const double w : k.inverse({0, 0, 1})) EXPECT_GT(w, 0);
  EXPECT_NE(disagreement({1, 0, 0, 0}), 0);
}

// The heading held at the middle of the step: second order.
Pose2 integrate_midpoint(const Pose2& X_AB, const Twist2& v, double dt) {
  const double mid = X_AB.yaw + 0.5 * v.wz * dt;
  const double c = std::cos(mid), s = std::sin(mid);
  return {X_AB.x + (c * v.vx - s * v.vy) * dt, X_AB.y + (s * v.vx + c * v.vy) * dt,
          perception::wrap_angle(X_AB.yaw + v.wz * dt)};
}

TEST(Planar, ExpMatchesFineEulerSteps) {
  rt::Random random(5);
  for (int i = 0; i < 50; ++i) {
    const Twist2 v{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-3, 3)};
    Pose2 slow;
    const int n = 20000;
    for (int j = 0; j < n; ++j) slow = integrate_midpoint(slow, v, 1.0 / n);
    const Pose2 fast = perception::integrate({}, v, 1.0);
    EXPECT_NEAR(fast.x, slow.x, 1e-8);
    EXPECT_NEAR(fast.y, slow.y, 1e-8);
    EXPECT_NEAR(perception::wrap_angle(fast.yaw - slow.yaw), 0, 1e-9);
  }
}

// The series below 1e-4 rad and the closed form meet without a step.
TEST(Planar, ExpIsSmoothAtTheSwitch) {
  const Pose2 below = perception::exp_se2({1, 2, 1e-4 * (1 - 1e-9)});
  const Pose2 above = perception::exp_se2({1, 2, 1e-4 * (1 + 1e-9)});
  EXPECT_NEAR(below.x, above.x, 1e-11);
  EXPECT_NEAR(below.y, above.y, 1e-11);
}

TEST(Planar, ComposeAndInverse) {
  rt::Random random(6);
  for (int i = 0; i < 200; ++i) {
    const Pose2 a{random.uniform(-9, 9), random.uniform(-9, 9), random.uniform(-9, 9)};
    const Pose2 e = compose(a, inverse(a));
    EXPECT_NEAR(e.x, 0, 1e-12);
    EXPECT_NEAR(e.y, 0, 1e-12);
    EXPECT_NEAR(e.yaw, 0, 1e-12);
  }
  EXPECT_DOUBLE_EQ(perception::wrap_angle(-std::numbers::pi), std::numbers::pi);
  EXPECT_TRUE(std::isnan(perception::wrap_angle(std::numeric_limits<double>::quiet_NaN())));
}

// Constant wheel speeds give an arc; sampled odometry follows it exactly, whatever the sample
// times.
TEST(Odometry, ArcIsExactForIrregularSamples) {
  const std::uint64_t seed = 21;
  rt::Random random(seed);
  const Mecanum k;
  for (int i = 0; i < 20; ++i) {
    const Twist2 v{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-0.8, 0.8)};
    const WheelVector w = k.inverse(v);
    Odometry odometry(k, {1, -2, 0.5});
    double t = 0;
    while (t < 5) {
      WheelVector angle{};
      for (int j = 0; j < 4; ++j) angle[j] = 100 + w[j] * t;  // any zero of the encoders
      ASSERT_TRUE(odometry.update(angle));
      if (t == 0) {
        ASSERT_EQ(odometry.pose(), (Pose2{1, -2, 0.5}));
      }
      const Pose2 want = perception::integrate({1, -2, 0.5}, v, t);
      ASSERT_NEAR(odometry.pose().x, want.x, 1e-10) << "seed " << seed;
      ASSERT_NEAR(odometry.pose().y, want.y, 1e-10) << "seed " << seed;
      t += random.uniform(0.001, 0.3);
    }
  }
}

TEST(Odometry, RefusesBrokenAngles) {
  Odometry odometry{Mecanum{}};
  ASSERT_TRUE(odometry.update({0, 0, 0, 0}));
  EXPECT_FALSE(odometry.update({std::numeric_limits<double>::quiet_NaN(), 0, 0, 0}));
  EXPECT_FALSE(odometry.update({1e4, -1e4, 0, 0}));  // 200 m in a cycle
  EXPECT_EQ(odometry.pose(), Pose2{});
  EXPECT_TRUE(odometry.update({0.1, 0.1, 0.1, 0.1}));
  EXPECT_GT(odometry.pose().yaw, 0);
}

}  // namespace
