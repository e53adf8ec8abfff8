// Odometry that is wrong by metres: a wheel slips in the dark, the robot's side begins anew. The
// lost camera is to be found by what it sees.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/unit/tasks_fusion/hall.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::in_hall;
using tests::kDt;
using tests::off_m;
using tests::Rig;

struct Wheels {
  Pose X_OB = Pose::Identity();
  void told(Rig& rig) const {
    OdometryPrior o;
    o.taken = rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * kDt - 0.02)};
    o.X_OB = X_OB;
    rig.in.odometry = o;
  }
};

// The hall is seen all round, and then from one place with odometry that is right.
void get_to_know(Rig& rig, const AnalyticScene& scene, const Wheels& wheels) {
  tests::tour(rig, scene, 120, 0.1);
  for (int i = 0; i < 10; ++i) {
    wheels.told(rig);
    rig.see(scene, in_hall(0), 0.0015);
    ASSERT_TRUE(rig.out.camera.claimed);
  }
}

// Frames until it is claimed, at most 16.
int back_after(Rig& rig, const AnalyticScene& scene, const Wheels& wheels, double yaw) {
  int took = 0;
  do {
    ++took;
    wheels.told(rig);
    rig.see(scene, in_hall(yaw), 0.0015);
  } while (!rig.out.camera.claimed && took < 16);
  return took;
}

struct Slip {
  const char* name;
  double x_m, turn_rad;
};

TEST(WrongOdometry, ASlipInTheDarkIsFoundOut) {
  const AnalyticScene scene = tests::hall();
  for (const Slip& slip : {Slip{"4 m", 4, 0}, Slip{"-30 m", -30, 0},
                           Slip{"half a turn", 0, std::numbers::pi}, Slip{"0.6 m", 0.6, 0}}) {
    Rig rig(tests::coarse(), in_hall(0));
    Wheels wheels;
    get_to_know(rig, scene, wheels);
    for (int i = 1; i <= 30; ++i) {
      wheels.X_OB.translation().x() = slip.x_m * i / 30;
      wheels.X_OB.linear() =
          Eigen::AngleAxisd(slip.turn_rad * i / 30, Vec3::UnitZ()).toRotationMatrix();
      wheels.told(rig);
      rig.see(AnalyticScene{}, in_hall(0));
    }
    EXPECT_EQ(rig.out.camera.tracking, CameraPose::Tracking::kLost);
    const int took = back_after(rig, scene, wheels, 0);
    std::printf("  slipped by %s: claimed after %d frames, %.1f mm off\n", slip.name, took,
                1000 * off_m(rig, in_hall(0)));
    EXPECT_LE(took, 15) << slip.name;
    EXPECT_LT(off_m(rig, in_hall(0)), 0.02) << slip.name;
  }
}

TEST(WrongOdometry, OneThatBeginsAnewIsFoundOut) {
  const AnalyticScene scene = tests::hall();
  for (const double jump_m : {-3.0, -1.5, 1.2, 5.0, 100.0}) {
    Rig rig(tests::coarse(), in_hall(0));
    Wheels wheels;
    get_to_know(rig, scene, wheels);
    wheels.X_OB.translation().x() = jump_m;
    const int took = back_after(rig, scene, wheels, 0);
    std::printf("  jumped by %.1f m: claimed after %d frames, %.1f mm off\n", jump_m, took,
                1000 * off_m(rig, in_hall(0)));
    EXPECT_LE(took, 15) << jump_m;
    EXPECT_LT(off_m(rig, in_hall(0)), 0.02) << jump_m;
  }
}

}  // namespace
}  // namespace tasks
