// The renderer's bytes, on whatever instruction set this machine has.
#include <gtest/gtest.h>

#include <memory>

#include "drivers/camera/render.hpp"
#include "drivers/camera/synthetic_camera.hpp"
#include "rt/hash.hpp"
#include "tests/unit/drivers_camera/scene.hpp"

namespace {

using camera_test::startup;
using drivers::DepthNoise;
using drivers::RenderScratch;
using drivers::SyntheticCameraConfig;
using drivers::World;
using drivers::WorldConfig;
using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

// Each instruction set that the loops are compiled for gives the bytes that this hash was made of.
// No angle is turned by: a math library's last bit may differ between machines.
TEST(Render, BytesAreTheSameOnEveryMachine) {
  WorldConfig c;
  c.room.x_m = {-3, 3}, c.room.y_m = {-3, 3};
  auto& b = c.boxes.emplace_back();
  b.name = "b", b.position_m = {1.6, 0.3, 0.4}, b.size_m = {0.5, 0.4, 0.8};
  b.paint.texture = "checker";
  auto& y = c.cylinders.emplace_back();
  y.name = "y", y.position_m = {2.0, -0.6, 0.5}, y.radius_m = 0.2, y.height_m = 1.0;
  auto& s = c.spheres.emplace_back();
  s.name = "s", s.position_m = {1.2, -0.2, 0.3}, s.radius_m = 0.15;
  auto& r = c.capsules.emplace_back();
  r.name = "r", r.from_m = {1.5, 0.9, 0.2}, r.to_m = {1.5, 0.9, 0.9}, r.radius_m = 0.1;
  const World world(startup.token(), c);
  RenderScratch scratch(startup.token(), world.shapes().size());
  const auto frame = std::make_unique<RgbdFrame>();
  Pose X = Pose::Identity();
  X.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  X.translation() = Vec3(0.1, 0.05, 0.6);
  const auto shoot = [&](const DepthNoise& noise) {
    render(world, SyntheticCameraConfig{}.intrinsics(), X, {}, noise, 42, 7, scratch, *frame);
    rt::Hash64 h;
    const std::size_t n = 512UL * 424;
    h.bytes(frame->depth_mm.data(), n * sizeof frame->depth_mm[0]);
    h.bytes(frame->colour.data(), n * sizeof frame->colour[0]);
    return h.digest();
  };
  EXPECT_EQ(shoot({}), 11417550394919560904U);
  EXPECT_EQ(shoot(DepthNoise(startup.token(), {1.0, 0.3, 0.4, 0.2})), 3916235203893987116U);
}

}  // namespace
