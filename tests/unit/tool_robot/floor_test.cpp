// The floor of a rendered image tells how the camera is mounted, and what is no floor tells
// nothing.
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>

#include "drivers/world/world.hpp"
#include "tests/unit/tool_robot/drives.hpp"
#include "tools/robot/floor_seen.hpp"

namespace tests {
namespace {

rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

// What a camera so mounted sees of an empty room from its middle.
std::unique_ptr<perception::RgbdFrame> seen_from(const drivers::SyntheticCameraConfig& config) {
  drivers::WorldConfig place;
  place.room.x_m = {-3, 3}, place.room.y_m = {-3, 3};
  place.room.height_m = 2.5;
  const drivers::World world(startup().token(), place, rt::Time{});
  drivers::FixedPose pose(config.X_BC());
  drivers::SyntheticCamera camera(startup().token(), config, world, pose, rt::Time{});
  auto frame = std::make_unique<perception::RgbdFrame>();
  camera.expose(0, *frame);
  return frame;
}

TEST(FloorSeen, TellsHeightAndTiltOfAnyMountNearTheStatedOne) {
  const Pose stated = drivers::SyntheticCameraConfig{}.X_BC();
  double worst_m = 0, worst_rad = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    drivers::SyntheticCameraConfig c;
    c.noise.axial = 1.0;
    c.seed = seed;
    c.mount_position_m[2] += random.uniform(-0.2, 0.2);
    c.mount_pitch_deg += random.uniform(-8, 8);
    c.mount_roll_deg = random.uniform(-8, 8);
    c.mount_yaw_deg = random.uniform(-180, 180);
    const auto frame = seen_from(c);
    const auto floor = teletact::floor_seen(*frame, stated, seed);
    ASSERT_TRUE(floor);
    const Vec3 up_C = c.X_BC().linear().transpose() * Vec3::UnitZ();
    worst_m = std::max(worst_m, std::abs(floor->height_m - c.mount_position_m[2]));
    worst_rad = std::max(worst_rad, std::acos(std::min(1.0, floor->up_C.dot(up_C))));
  }
  std::printf("  off by %.2f mm and %.3f deg at most\n", 1e3 * worst_m, worst_rad / kDeg);
  EXPECT_LT(worst_m, 0.003);
  EXPECT_LT(worst_rad, 0.2 * kDeg);
}

TEST(FloorSeen, IsNotSeenWhereThereIsNone) {
  drivers::SyntheticCameraConfig up;
  up.mount_pitch_deg = -40;
  EXPECT_FALSE(teletact::floor_seen(*seen_from(up), drivers::SyntheticCameraConfig{}.X_BC(), 1));
  const auto dark = std::make_unique<perception::RgbdFrame>();
  dark->intrinsics = drivers::SyntheticCameraConfig{}.intrinsics();
  EXPECT_FALSE(teletact::floor_seen(*dark, drivers::SyntheticCameraConfig{}.X_BC(), 1));
}

}  // namespace
}  // namespace tests
