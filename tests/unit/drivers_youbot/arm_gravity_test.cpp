// The arm's weight against a potential that shares no code with it: the URDF chain multiplied out,
// every centre of mass a point in its link's frame, torque by central differences of the energy.
#include "drivers/youbot/arm_gravity.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "rt/random.hpp"

namespace tests {
namespace {

using drivers::ArmAngles;
using drivers::ArmMasses;

constexpr double kDeg = std::numbers::pi / 180;

Eigen::Isometry3d joint(double x, double z, double rpy_rad, const Eigen::Vector3d& rpy_axis,
                        double q, const Eigen::Vector3d& axis) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translate(Eigen::Vector3d(x, 0, z));
  T.rotate(Eigen::AngleAxisd(rpy_rad, rpy_axis));
  T.rotate(Eigen::AngleAxisd(q, axis));
  return T;
}

// youbot_description, arm.urdf.xacro, as the reference's table has it.
double energy_J(const ArmAngles& q, const ArmMasses& m) {
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  const auto link1 = joint(0.024, 0.096, 170 * kDeg, z, q[0], -z);
  const auto link2 = link1 * joint(0.033, 0.019, -65 * kDeg, y, q[1], y);
  const auto link3 = link2 * joint(0, 0.155, 146 * kDeg, y, q[2], y);
  const auto link4 = link3 * joint(0, 0.135, -102.5 * kDeg, y, q[3], y);
  const auto link5 = link4 * joint(-0.002, 0.130, 167.5 * kDeg, z, q[4], -z);
  const auto height = [](const Eigen::Isometry3d& X, double along) {
    return (X * Eigen::Vector3d(0, 0, along)).z();
  };
  return 9.81 * (m.link_kg[0] * height(link2, m.centre_m[0]) +
                 m.link_kg[1] * height(link3, m.centre_m[1]) +
                 m.link_kg[2] * height(link4, m.centre_m[2]) +
                 m.link_kg[3] * height(link5, m.centre_m[3] - 0.130) +
                 (m.gripper_kg + m.payload_kg) * height(link5, 0));
}

TEST(ArmGravity, IsTheSlopeOfTheEnergyAtTenThousandPoses) {
  rt::Random random(7);
  const drivers::ArmLimits limits;
  for (int i = 0; i < 10'000; ++i) {
    ArmAngles q;
    for (std::size_t j = 0; j < q.size(); ++j)
      q[j] = limits.low[j] + (limits.high[j] - limits.low[j]) * random.uniform();
    ArmMasses m;
    m.payload_kg = random.uniform();
    const ArmAngles torque = drivers::arm_gravity_Nm(q, m);
    for (std::size_t j = 0; j < q.size(); ++j) {
      constexpr double kStep = 1e-5;
      ArmAngles more = q, less = q;
      more[j] += kStep;
      less[j] -= kStep;
      const double slope = -(energy_J(more, m) - energy_J(less, m)) / (2 * kStep);
      ASSERT_NEAR(torque[j], slope, 1e-7) << "joint " << j + 1;
    }
  }
}

// By hand: the candle stands on itself but for the tool's 2 mm; stretched out level, all of it is
// one lever at joint 2.
TEST(ArmGravity, TwoPosesByHand) {
  const ArmAngles candle{2.9, 65 * kDeg, -146 * kDeg, 102.5 * kDeg, 2.9};
  for (const double t : drivers::arm_gravity_Nm(candle)) EXPECT_LT(std::abs(t), 0.011);
  const ArmAngles level{2.9, 155 * kDeg, -146 * kDeg, 102.5 * kDeg, 2.9};
  const double lever = 1.155 * 0.1045 + 0.934 * (0.155 + 0.0967) + 0.877 * (0.290 + 0.051) +
                       0.251 * (0.290 + 0.1132) + 0.245 * (0.290 + 0.130);
  EXPECT_NEAR(drivers::arm_gravity_Nm(level)[1], 9.81 * lever, 1e-9);
}

}  // namespace
}  // namespace tests
