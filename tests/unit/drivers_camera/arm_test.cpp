// The scripted arm: where it is, what is said of it, and that the camera sees it there.
#include "drivers/camera/scripted_arm.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "drivers/camera/synthetic_camera.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/paths.hpp"
#include "tests/unit/drivers_camera/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using camera_test::base_pose;
using camera_test::load_world;
using camera_test::startup;
using drivers::ScriptedArm;
using drivers::ScriptedArmConfig;
using drivers::SyntheticCamera;
using drivers::SyntheticCameraConfig;
using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;
using ::testing::HasSubstr;

constexpr double kDeg = std::numbers::pi / 180;

rt::Time seconds(double s) { return rt::Time{rt::nanos_from_seconds(s)}; }

perception::RobotDescription youbot() {
  auto r = perception::load_robot(tests::in_tree("config/robots/youbot.toml"));
  if (!r) throw std::runtime_error(r.error());
  return std::move(r).value();
}

ScriptedArmConfig reach() {
  ScriptedArmConfig c;
  c.keys.push_back({1.0, {169, 65, -146, 102.5, 167.5}});
  c.keys.push_back({3.0, {169, 140, -146, 102.5, 167.5}});
  c.keys.push_back({4.0, {150, 140, -100, 102.5, 167.5}});
  return c;
}

ScriptedArm make(const ScriptedArmConfig& c, rt::Time t0 = {}) {
  return ScriptedArm(startup.token(), c, youbot(), t0);
}

TEST(ScriptedArm, StandsAtItsKeysAndMovesSmoothlyBetween) {
  const ScriptedArm arm = make(reach(), seconds(100));
  const auto at = [&arm](double s) { return arm.at(seconds(100 + s)); };
  EXPECT_NEAR(at(0).q[1], 65 * kDeg, 1e-12);
  EXPECT_NEAR(at(3).q[1], 140 * kDeg, 1e-12);
  EXPECT_NEAR(at(9).q[2], -100 * kDeg, 1e-12);
  EXPECT_NEAR(at(2).q[1], 102.5 * kDeg, 1e-9);  // half the way at half the time
  for (const double s : {0.0, 1.0, 3.0, 4.0, 9.0}) EXPECT_NEAR(at(s).speed[1], 0, 1e-9) << s;
  for (double s = 0.01; s < 5; s += 0.01) {  // the speed said is the slope
    for (std::size_t j = 0; j < 5; ++j)
      ASSERT_NEAR(at(s).speed[j], (at(s + 1e-5).q[j] - at(s - 1e-5).q[j]) / 2e-5, 2e-3) << s;
  }
}

TEST(ScriptedArm, SaysWhatItIsToldToSay) {
  auto c = reach();
  const auto exact = make(c).reported(seconds(2));
  EXPECT_EQ(exact.count, 5);
  EXPECT_EQ(exact.age_s, 0);
  EXPECT_EQ(exact.error, 0);
  EXPECT_FLOAT_EQ(exact.position[1], static_cast<float>(102.5 * kDeg));
  c.joint_delay_ms = 50;
  c.joint_error_deg = -2;
  const ScriptedArm arm = make(c);
  const auto off = arm.reported(seconds(2));
  EXPECT_NEAR(off.position[1], arm.at(seconds(1.95)).q[1] - 2 * kDeg, 1e-6);
  EXPECT_NEAR(off.speed[1], arm.at(seconds(1.95)).speed[1], 1e-6);
  EXPECT_FLOAT_EQ(off.age_s, 0.05F);
  EXPECT_FLOAT_EQ(off.error, static_cast<float>(2 * kDeg));
  EXPECT_THAT(arm.effects(),
              ::testing::ElementsAre("an arm before the camera", "joints reported late",
                                     "joints reported wrong"));
  c.stated_age_ms = 10, c.stated_error_deg = 0.5;  // it does not know how wrong it is
  EXPECT_FLOAT_EQ(make(c).reported(seconds(2)).age_s, 0.01F);
  EXPECT_FLOAT_EQ(make(c).reported(seconds(2)).error, static_cast<float>(0.5 * kDeg));
}

TEST(ScriptedArm, RefusesWhatTheArmCanNotDo) {
  const auto refusal = [](const ScriptedArmConfig& c) -> std::string {
    try {
      (void)make(c);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "accepted";
  };
  auto c = reach();
  c.keys[1].time_s = 1.0;
  EXPECT_THAT(refusal(c), HasSubstr("'robot.arm.key[1].time_s' = 1: allowed more than"));
  c = reach();
  c.keys[0].angles_deg[2] = 10;
  EXPECT_THAT(refusal(c), HasSubstr("'robot.arm.key[0].angles_deg[2]' = 10: allowed -29"));
  c = reach();
  c.keys[1].time_s = 1.5;  // 75 degrees in half a second
  EXPECT_THAT(refusal(c), HasSubstr("'robot.arm.key[1].angles_deg[1]' = 140"));
}

// Said twice, here and where the twins have it: until they read the description.
TEST(RobotFile, YoubotsMountAndBoxesAreTheTwins) {
  const auto d = youbot();
  const SyntheticCameraConfig camera;
  EXPECT_EQ(d.camera_position_m, camera.mount_position_m);
  EXPECT_EQ(d.camera_yaw_deg, camera.mount_yaw_deg);
  EXPECT_EQ(d.camera_pitch_deg, camera.mount_pitch_deg);
  const auto boxes = drivers::youbot_body();
  ASSERT_EQ(d.base_boxes.size(), boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    for (std::size_t a = 0; a < 3; ++a) {
      const auto axis = static_cast<Eigen::Index>(a);
      EXPECT_NEAR(d.base_boxes[i].centre_m[a], boxes[i].centre_B(axis), 1e-12);
      EXPECT_NEAR(d.base_boxes[i].size_m[a], 2 * boxes[i].half(axis), 1e-12);
    }
  }
}

// Every pixel shows what a ray cast into a world with the arm's capsules in it meets.
TEST(ScriptedArm, TheCameraSeesItWhereItIs) {
  const drivers::World room = load_world("default_room.toml");
  const SyntheticCameraConfig config;
  for (const double x : {0.0, 0.4}) {
    const Pose X_WB = base_pose(x, 0.1, 0.3);
    drivers::FixedPose pose(X_WB * config.X_BC());
    SyntheticCamera camera(startup.token(), config, room, pose, {});
    auto carried = std::make_unique<ScriptedArm>(startup.token(), reach(), youbot(), rt::Time{});
    ScriptedArm arm = make(reach());
    camera.carry(startup.token(), std::move(carried));
    auto frame = std::make_unique<RgbdFrame>();
    rt_guard::reset();
    {
      rt::Section section;
      camera.expose(75, *frame);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    EXPECT_EQ(frame->joints, arm.reported(camera.mid_exposure(75)));
    const auto shapes = arm.place(camera.mid_exposure(75), X_WB);
    const auto& k = frame->intrinsics;
    int of_arm = 0;
    for (int v = 0; v < k.height; v += 3) {
      for (int u = 0; u < k.width; u += 3) {
        const Vec3 d = pose.X_WC_at({}).linear() * Vec3((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
        const Vec3 o = pose.X_WC_at({}).translation();
        double z = room.ray_cast(o, d).t;
        bool arms = false;
        for (const auto& s : shapes) {  // the nearest of them, by marching
          const Vec3 mid = s.X_WS.translation(), way = s.X_WS.linear().col(2);
          for (double t = 0.2; t < z;) {
            const Vec3 p = o + t * d - mid;
            const double a = std::clamp(p.dot(way), -s.half.z(), s.half.z());
            const double off = (p - a * way).norm() - s.half.x();
            if (off < 1e-6) {
              z = t;
              arms = true;
              break;
            }
            t += off / d.norm();
          }
        }
        of_arm += arms;
        const int want = z >= 0.4 && z <= 5.0 ? static_cast<int>(z * 1000 + 0.5) : 0;
        ASSERT_NEAR(frame->depth().at(u, v), want, std::abs(z - 0.4) < 1e-3 ? 500 : 1)
            << u << ' ' << v;
      }
    }
    EXPECT_GT(of_arm, 200);
  }
}

TEST(ScriptedArm, WithoutOneNothingIsDifferent) {
  const drivers::World room = load_world("default_room.toml");
  const SyntheticCameraConfig config;
  drivers::FixedPose pose(config.X_BC());
  SyntheticCamera camera(startup.token(), config, room, pose, {});
  auto a = std::make_unique<RgbdFrame>(), b = std::make_unique<RgbdFrame>();
  a->joints.count = 3;  // of whoever had the slot before
  camera.expose(4, *a);
  EXPECT_EQ(a->joints.count, 0);
  drivers::RenderScratch scratch(startup.token(), room.shapes().size());
  render(room, camera.intrinsics(), config.X_BC(), {}, camera.noise(), config.seed, 4, scratch, *b);
  EXPECT_EQ(a->depth_mm, b->depth_mm);
  EXPECT_EQ(a->colour, b->colour);
}

}  // namespace
