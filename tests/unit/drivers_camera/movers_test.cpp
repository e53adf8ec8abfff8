// The synthetic camera looks at things that move: the picture of an instant is that of a world in
// which everything stands where it is then, colours and all.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "drivers/camera/synthetic_camera.hpp"
#include "tests/unit/drivers_camera/scene.hpp"

namespace {

using camera_test::startup;
using drivers::RenderScratch;
using drivers::World;
using drivers::WorldConfig;
using perception::Intrinsics;
using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

constexpr Intrinsics kCamera{182.5, 182.5, 127.5, 105.5, 256, 212};

Pose looking_along_x() {
  Pose X = Pose::Identity();
  X.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  X.translation() = Vec3(0, 0, 1);
  return X;
}

// A box, a ball and a column before a wall; `moved_m` along y.
WorldConfig place(double moved_m) {
  WorldConfig c;
  auto& wall = c.planes.emplace_back();
  wall.name = "wall", wall.point_m = {3, 0, 0}, wall.normal = {-1, 0, 0};
  auto& b = c.boxes.emplace_back();
  b.name = "box", b.size_m = {0.5, 0.5, 0.5}, b.position_m = {1.5, -0.5 + moved_m, 1};
  auto& ball = c.spheres.emplace_back();
  ball.name = "ball", ball.position_m = {1.25, 0.25 + moved_m, 1.25}, ball.radius_m = 0.25;
  auto& column = c.cylinders.emplace_back();
  column.name = "column", column.position_m = {2, 0.5 + moved_m, 0}, column.radius_m = 0.25;
  column.height_m = 2;
  return c;
}

WorldConfig moving_place() {
  WorldConfig c = place(0);
  auto& m = c.movers.emplace_back();
  m.name = "all", m.shapes = "box, ball, column", m.velocity_m_per_s = {0, 0.5, 0};
  return c;
}

struct Lens {
  explicit Lens(const World& w) : world(w), scratch(startup.token(), w.shapes().size()) {}
  const RgbdFrame& shoot(rt::Time t) {
    drivers::render(world, kCamera, looking_along_x(), {}, {}, 1, 0, scratch, *frame, t);
    return *frame;
  }
  const World& world;
  RenderScratch scratch;
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
};

constexpr std::size_t kPixels = 256UL * 212UL;

// 0.25 m and the places are exact in binary: the two pictures are the same bytes.
TEST(MovingPicture, IsThatOfTheInstantWithItsColours) {
  const World moving(startup.token(), moving_place()), then(startup.token(), place(0.25));
  Lens lens(moving), oracle(then);
  const RgbdFrame& a = lens.shoot(rt::Time{} + rt::Nanos{500'000'000});
  const RgbdFrame& b = oracle.shoot(rt::Time{});
  int differ = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    differ += a.depth_mm[i] != b.depth_mm[i] || !(a.colour[i] == b.colour[i]) ? 1 : 0;
  }
  EXPECT_EQ(differ, 0);
  const World before(startup.token(), place(0));
  Lens other(before);
  const RgbdFrame& c = other.shoot(rt::Time{});
  int changed = 0;
  for (std::size_t i = 0; i < kPixels; ++i) changed += a.depth_mm[i] != c.depth_mm[i] ? 1 : 0;
  EXPECT_GT(changed, 3000);
}

TEST(MovingPicture, SaysWhichShapeAPixelShowsAndCanLeaveColourOut) {
  const World world(startup.token(), moving_place());
  Lens lens(world), plain(world);
  lens.scratch.shape.assign(RgbdFrame::kMaxPixels, 77);
  lens.scratch.colour = false;
  const rt::Time t = rt::Time{} + rt::Nanos{700'000'000};
  const RgbdFrame& a = lens.shoot(t);
  const RgbdFrame& b = plain.shoot(t);
  EXPECT_FALSE(a.has_colour);
  EXPECT_TRUE(b.has_colour);
  const Pose X_WC = looking_along_x();
  std::array<int, 4> seen{};
  for (int v = 0; v < kCamera.height; v += 3) {
    for (int u = 0; u < kCamera.width; u += 3) {
      const auto i = static_cast<std::size_t>(v * kCamera.width + u);
      ASSERT_EQ(a.depth_mm[i], b.depth_mm[i]);
      const auto hit =
          world.ray_cast(X_WC.translation(), X_WC.linear() * kCamera.unproject(u, v, 1), t);
      ASSERT_EQ(lens.scratch.shape[i], hit.shape) << u << ", " << v;
      if (hit) ++seen[static_cast<std::size_t>(hit.shape)];
    }
  }
  for (const int n : seen) EXPECT_GT(n, 20);
}

// The frame shows the middle of its exposure.
TEST(MovingPicture, TheCameraShowsTheMiddleOfTheExposure) {
  WorldConfig c;
  auto& door = c.boxes.emplace_back();
  door.name = "door", door.size_m = {0.1, 8, 8}, door.position_m = {2.05, 0, 1};
  auto& m = c.movers.emplace_back();
  m.name = "comes", m.shapes = "door", m.velocity_m_per_s = {-1, 0, 0};
  const rt::Time t0{rt::Nanos{3'000'000'000}};
  const World world(startup.token(), c, t0);
  drivers::SyntheticCameraConfig config;
  config.resolution = "half", config.exposure_ms = 20;
  drivers::FixedPose pose(looking_along_x());
  drivers::SyntheticCamera camera(startup.token(), config, world, pose, t0);
  auto frame = std::make_unique<RgbdFrame>();
  for (const std::uint64_t f : {0U, 3U, 30U}) {
    camera.expose(f, *frame);
    const double middle_s = static_cast<double>(f) / 30.0 + 0.010;
    EXPECT_NEAR(frame->depth_mm[106 * 256 + 128], 1e3 * (2.0 - middle_s), 0.51) << f;
  }
}

}  // namespace
