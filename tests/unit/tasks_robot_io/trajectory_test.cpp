#include "tasks/robot_io/trajectory.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rt/random.hpp"

namespace {

using perception::Pose2;
using tasks::PlanarVelocity;
using tasks::Trajectory;
using tasks::TrajectoryConfig;
using tasks::TrajectoryTarget;

constexpr double kT = 1e-3;

// An ideal base: it does what it is told.
struct Ideal {
  explicit Ideal(const TrajectoryConfig& c) : trajectory(c) { trajectory.zero_at_once(X); }
  PlanarVelocity tick(const TrajectoryTarget& t) {
    const PlanarVelocity v = trajectory.track(t, X, kT);
    X = {X.x + v.x * kT, X.y + v.y * kT, perception::wrap_angle(X.yaw + v.yaw * kT)};
    return v;
  }
  Pose2 X;
  Trajectory trajectory;
};

// From any braking speed, braking at the curve's acceleration ends before the distance does.
TEST(BrakingSpeed, NeverPassesTheDistance) {
  rt::Random random(3);
  for (int i = 0; i < 2000; ++i) {
    const double d = std::pow(10.0, random.uniform(-6, 1)), a = random.uniform(0.1, 3);
    double left = d;
    for (int k = 0; k < 100000 && left > 1e-9; ++k) {
      const double v = tasks::braking_speed(left, a, kT);
      ASSERT_GE(v, 0);
      left -= v * kT;
      ASSERT_GE(left, 0);
      // And the curve itself asks for no more than a.
      ASSERT_LE(v - tasks::braking_speed(left, a, kT), a * kT * (1 + 1e-9));
    }
  }
  EXPECT_EQ(tasks::braking_speed(0, 1, kT), 0);
  EXPECT_EQ(tasks::braking_speed(-1, 1, kT), 0);
}

// From rest to a fixed goal: straight, no overshoot, near the time of the trapezoid.
TEST(Trajectory, FromRestArrivesWithoutOvershootNearTheOptimalTime) {
  const std::uint64_t seed = 41;
  rt::Random random(seed);
  TrajectoryConfig c;
  for (int i = 0; i < 100; ++i) {
    Ideal base(c);
    TrajectoryTarget t;
    t.X_OG = {random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-3, 3)};
    const double d = std::hypot(t.X_OG.x, t.X_OG.y);
    const double ux = t.X_OG.x / d, uy = t.X_OG.y / d;
    double arrival = 0, along_max = 0, across_max = 0;
    for (int k = 0; k < 15000; ++k) {
      base.tick(t);
      along_max = std::max(along_max, base.X.x * ux + base.X.y * uy - d);
      across_max = std::max(across_max, std::abs(base.X.x * uy - base.X.y * ux));
      if (arrival == 0 && std::hypot(base.X.x - t.X_OG.x, base.X.y - t.X_OG.y) < 0.01) {
        arrival = k * kT;
      }
    }
    ASSERT_LT(std::hypot(base.X.x - t.X_OG.x, base.X.y - t.X_OG.y), 1e-4) << "seed " << seed;
    ASSERT_LT(std::abs(perception::wrap_angle(base.X.yaw - t.X_OG.yaw)), 1e-3);
    ASSERT_LT(along_max, 2e-4) << "overshoot, seed " << seed << " case " << i;
    ASSERT_LT(across_max, 1e-6);
    const double v = c.speed_m_per_s, a = c.acceleration_m_per_s2;
    const double best = d > v * v / a ? d / v + v / a : 2 * std::sqrt(d / a);
    ASSERT_LT(arrival, 1.25 * best + 0.25) << "slow, seed " << seed << " case " << i;
  }
}

// Goals that jump about at random instants: speed and acceleration stay inside their limits always.
TEST(Trajectory, LimitsHoldForJumpingGoals) {
  const std::uint64_t seed = 43;
  rt::Random random(seed);
  TrajectoryConfig c;
  for (int i = 0; i < 20; ++i) {
    Ideal base(c);
    TrajectoryTarget t;
    PlanarVelocity last;
    for (int k = 0; k < 10000; ++k) {
      if (random.uniform() < 0.01) {
        t.X_OG = {random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3.1, 3.1)};
        t.v_O = {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
        t.speed_limit_m_per_s = random.uniform(0.3, 2);
      }
      if (random.uniform() < 0.002) {  // somebody shoves the base: large tracking errors
        base.X.x += random.uniform(-0.3, 0.3);
        base.X.yaw += random.uniform(-1, 1);
      }
      const bool braking = random.uniform() < 0.05, down = random.uniform() < 0.02;
      const PlanarVelocity v = down      ? base.trajectory.ramp_down(base.X, kT)
                               : braking ? base.trajectory.brake(base.X, kT)
                                         : base.tick(t);
      ASSERT_LE(std::hypot(v.x, v.y), c.speed_m_per_s * (1 + 1e-9)) << "seed " << seed;
      ASSERT_LE(std::abs(v.yaw), c.yaw_rate_rad_per_s * (1 + 1e-9)) << "seed " << seed;
      const double a = down ? c.ramp_down_deceleration_m_per_s2 : c.acceleration_m_per_s2;
      const double a_yaw =
          down ? c.ramp_down_yaw_deceleration_rad_per_s2 : c.yaw_acceleration_rad_per_s2;
      ASSERT_LE(std::hypot(v.x - last.x, v.y - last.y), a * kT * (1 + 1e-6));
      ASSERT_LE(std::abs(v.yaw - last.yaw), a_yaw * kT * (1 + 1e-6));
      if (down) {
        ASSERT_LE(std::hypot(v.x, v.y), std::hypot(last.x, last.y)) << "a ramp only goes down";
      }
      last = v;
    }
  }
}

// A goal that comes from the side while driving: it may be passed only by what braking costs, and
// the base still arrives.
TEST(Trajectory, GoalChangedOnTheWayIsStillReached) {
  rt::Random random(47);
  for (int i = 0; i < 100; ++i) {
    Ideal base{TrajectoryConfig{}};
    TrajectoryTarget t;
    t.X_OG = {3, 0, 0};
    for (int k = 0; k < 1500; ++k) base.tick(t);
    t.X_OG = {base.X.x + random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1};
    for (int k = 0; k < 8000; ++k) base.tick(t);
    ASSERT_LT(std::hypot(base.X.x - t.X_OG.x, base.X.y - t.X_OG.y), 1e-3);
  }
}

TEST(Trajectory, LeashKeepsTheReferenceNearAStuckBase) {
  TrajectoryConfig c;
  Trajectory trajectory(c);
  TrajectoryTarget t;
  t.X_OG = {5, 0, 2};
  const Pose2 stuck;
  for (int k = 0; k < 5000; ++k) {
    trajectory.track(t, stuck, kT);
    ASSERT_LE(trajectory.reference().x, c.leash_m + 1e-12);
    ASSERT_LE(std::abs(trajectory.reference().yaw), c.leash_rad + 1e-12);
  }
}

// A goal with a velocity is passed at that velocity, not stopped at.
TEST(Trajectory, DrivesThroughAGoalWithVelocity) {
  Ideal base{TrajectoryConfig{}};
  TrajectoryTarget t;
  t.X_OG = {1, 0, 0};
  t.v_O = {0.4, 0, 0};
  double speed_at_goal = 0;
  for (int k = 0; k < 4000 && base.X.x < 0.999; ++k) speed_at_goal = base.tick(t).x;
  EXPECT_NEAR(speed_at_goal, 0.4, 0.03);
}

}  // namespace
