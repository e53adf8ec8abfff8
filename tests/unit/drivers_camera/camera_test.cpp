// SyntheticCamera and ThreadedCamera as cameras: which frame when, from which pose.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include "drivers/camera/newest_frame.hpp"
#include "drivers/camera/synthetic_camera.hpp"
#include "drivers/camera/threaded_camera.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_camera/scene.hpp"

namespace {

using camera_test::base_pose;
using camera_test::load_world;
using camera_test::startup;
using drivers::CameraStatus;
using drivers::SyntheticCamera;
using drivers::SyntheticCameraConfig;
using perception::Pose;
using perception::RgbdFrame;

class Recording : public drivers::PoseSource {
 public:
  explicit Recording(const Pose& X_BC) : X_BC_(X_BC) {}
  Pose X_WC_at(rt::Time t) noexcept override {
    asked.push_back(t);
    return base_pose(0.1 * rt::seconds(t.time_since_epoch()), 0, 0) * X_BC_;
  }
  std::vector<rt::Time> asked;

 private:
  Pose X_BC_;
};

TEST(SyntheticCamera, MountLooksForwardAndDown) {
  SyntheticCameraConfig c;
  c.mount_pitch_deg = 0;
  EXPECT_TRUE(
      (c.X_BC().linear() * perception::Vec3(0, 0, 1)).isApprox(perception::Vec3(1, 0, 0), 1e-12));
  EXPECT_TRUE(
      (c.X_BC().linear() * perception::Vec3(1, 0, 0)).isApprox(perception::Vec3(0, -1, 0), 1e-12));
  c.mount_pitch_deg = 90;
  EXPECT_TRUE(
      (c.X_BC().linear() * perception::Vec3(0, 0, 1)).isApprox(perception::Vec3(0, 0, -1), 1e-12));
  c.mount_pitch_deg = 0, c.mount_yaw_deg = 90;
  EXPECT_TRUE(
      (c.X_BC().linear() * perception::Vec3(0, 0, 1)).isApprox(perception::Vec3(0, 1, 0), 1e-12));
  EXPECT_NEAR(c.X_BC().linear().determinant(), 1, 1e-12);
}

// Rolled clockwise, what was right in the image points down; and the true mount is the synthetic
// camera's alone.
TEST(SyntheticCamera, RollAndTrueMount) {
  drivers::SyntheticCameraConfig c;
  EXPECT_TRUE(c.true_X_BC().matrix() == c.X_BC().matrix());
  c.mount_pitch_deg = 0, c.mount_roll_deg = 90;
  const perception::Vec3 right = c.X_BC().linear() * perception::Vec3(1, 0, 0),
                         ahead = c.X_BC().linear() * perception::Vec3(0, 0, 1);
  EXPECT_TRUE(right.isApprox(perception::Vec3(0, 0, -1), 1e-12));
  EXPECT_TRUE(ahead.isApprox(perception::Vec3(1, 0, 0), 1e-12));
  c = {};
  c.true_mount = {true, {-0.18, -0.01, 0.93}, 3, 28, 1};
  drivers::SyntheticCameraConfig truth;
  truth.mount_position_m = {-0.18, -0.01, 0.93};
  truth.mount_yaw_deg = 3, truth.mount_pitch_deg = 28, truth.mount_roll_deg = 1;
  EXPECT_TRUE(c.true_X_BC().matrix() == truth.X_BC().matrix());
  EXPECT_TRUE(c.X_BC().matrix() == drivers::SyntheticCameraConfig{}.X_BC().matrix());
  c.true_mount.differs = false;
  EXPECT_TRUE(c.true_X_BC().matrix() == c.X_BC().matrix());
}

TEST(SyntheticCamera, FrameIsCompleteAtItsInstantAndShowsTheMiddleOfTheExposure) {
  const auto world = load_world("default_room.toml");
  SyntheticCameraConfig config;
  config.resolution = "half";
  Recording pose(config.X_BC());
  const rt::Time t0 = rt::time_from_ns(5'000'000'000);
  SyntheticCamera camera(startup.token(), config, world, pose, t0);
  auto f = std::make_unique<RgbdFrame>();
  const auto at = [&](std::int64_t us) {
    return camera.poll(t0 + std::chrono::microseconds(us), *f);
  };
  EXPECT_EQ(at(-100000), CameraStatus::kNoFrame);
  EXPECT_EQ(at(9999), CameraStatus::kNoFrame);
  ASSERT_EQ(at(10000), CameraStatus::kFrame);
  EXPECT_EQ(f->seq, 0u);
  EXPECT_EQ(f->exposure, t0 + std::chrono::milliseconds(5));
  EXPECT_EQ(pose.asked.back(), f->exposure);
  EXPECT_EQ(f->intrinsics, config.intrinsics());
  EXPECT_EQ(at(10001), CameraStatus::kNoFrame);
  EXPECT_EQ(at(43332), CameraStatus::kNoFrame);
  ASSERT_EQ(at(43334), CameraStatus::kFrame);
  EXPECT_EQ(f->seq, 1u);
  ASSERT_EQ(at(10000 + 500000), CameraStatus::kFrame);  // frames 2..14 are lost
  EXPECT_EQ(f->seq, 15u);
  EXPECT_EQ(camera.rendered(), 3u);
  EXPECT_GT(camera.twin_cpu_ns(), 0);
}

TEST(SyntheticCamera, EveryFrameOnceWithAPollAtTheSameRate) {
  const auto world = load_world("empty_room.toml");
  SyntheticCameraConfig config;
  config.resolution = "half";
  drivers::FixedPose pose(config.X_BC());
  SyntheticCamera camera(startup.token(), config, world, pose, rt::Time{});
  auto f = std::make_unique<RgbdFrame>();
  // Polled exactly at the completion, computed by the same integer formula: no frame is lost.
  for (std::uint64_t k = 0; k < 300; ++k) {
    const rt::Time now =
        rt::Time{} + drivers::kCameraRate.release(k) + std::chrono::milliseconds(10);
    ASSERT_EQ(camera.poll(now, *f), CameraStatus::kFrame) << k;
    ASSERT_EQ(f->seq, k);
  }
}

// A clock of its own: later by its phase, and slower by its ppm; after days, too. Where capture
// polls in time with the box's clock, a slower camera has no frame now and then, and a faster one
// has one that is passed over.
TEST(SyntheticCamera, AClockOfItsOwnDriftsAgainstThePoll) {
  const auto world = load_world("empty_room.toml");
  auto f = std::make_unique<RgbdFrame>();
  for (const double ppm : {-1000.0, -50.0, 0.0, 300.0}) {
    SyntheticCameraConfig config;
    config.resolution = "half", config.phase_ms = 12.5, config.clock_ppm = ppm;
    EXPECT_TRUE(config.own_clock());
    drivers::FixedPose pose(config.X_BC());
    const rt::Time t0 = rt::time_from_ns(7'000'000'000);
    SyntheticCamera camera(startup.token(), config, world, pose, t0);
    for (const std::uint64_t n : {0ULL, 3ULL, 29ULL, 30'000ULL, 30ULL * 86'400 * 20}) {
      const long double own_s = static_cast<long double>(n) / 30 * (1 + 1e-6L * ppm);
      const long double at_s = 7 + 0.0125L + own_s + 0.010L;
      EXPECT_NEAR(static_cast<double>(1e9L * at_s -
                                      static_cast<long double>(rt::ns_of(camera.complete(n)))),
                  0, 2)
          << n;
      const rt::Time whole = camera.complete(n);
      EXPECT_EQ(camera.poll(whole - rt::Nanos{1}, *f),
                n == 0 ? CameraStatus::kNoFrame : CameraStatus::kFrame);
      if (n > 0) {
        EXPECT_EQ(f->seq, n - 1);
      }
      ASSERT_EQ(camera.poll(whole, *f), CameraStatus::kFrame);
      EXPECT_EQ(f->seq, n);
      EXPECT_EQ(f->exposure, whole - std::chrono::milliseconds(5));
    }
  }
}

// Against a list of what was published and when: the newest once, and the arrival of every one.
TEST(NewestFrame, TheNewestOnceAndEachArrival) {
  const std::uint64_t seed = 17;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  drivers::NewestFrame newest(startup.token());
  auto f = std::make_unique<RgbdFrame>();
  std::uint64_t made = 0, unseen = 0;
  for (std::int64_t n = 1; n <= 3000; ++n) {
    if (random.uniform() < 0.6) {
      RgbdFrame& slot = newest.begin_write();
      slot.intrinsics = {1, 1, 0, 0, 2, 1};
      slot.has_colour = false;
      slot.seq = ++made;
      newest.publish(rt::time_from_ns(n));
      ++unseen;
      rt::Time at;
      ASSERT_TRUE(newest.arrivals().try_pop(at));
      EXPECT_EQ(at, rt::time_from_ns(n));
      EXPECT_FALSE(newest.arrivals().try_pop(at));
    }
    if (random.uniform() < 0.4) continue;
    EXPECT_EQ(newest.take(*f), unseen > 0);
    EXPECT_EQ(f->seq, made);
    unseen = 0;
  }
  EXPECT_GT(made, 1000U);
}

TEST(ThreadedCamera, DeliversNewFramesInOrderAndStops) {
  const auto world = load_world("default_room.toml");
  SyntheticCameraConfig config;
  drivers::FixedPose pose(config.X_BC());
  const auto now = [] {
    return rt::time_from_ns(std::chrono::steady_clock::now().time_since_epoch().count());
  };
  const rt::Time t0 = now() + std::chrono::milliseconds(5);
  drivers::ThreadedCamera camera(
      startup.token(), std::make_unique<SyntheticCamera>(startup.token(), config, world, pose, t0),
      now);
  auto f = std::make_unique<RgbdFrame>();
  std::uint64_t frames = 0, last = 0;
  // Six frames: 0.2 s on a quiet machine; a loaded one gets its time.
  while (frames < 6 && now() < t0 + std::chrono::seconds(30)) {
    if (camera.poll(now(), *f) == CameraStatus::kFrame) {
      ASSERT_TRUE(frames == 0 || f->seq > last);
      ASSERT_LE(f->exposure + std::chrono::milliseconds(5),
                now());  // not before its shutter closed
      last = f->seq;
      ++frames;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
  }
  camera.stop();
  EXPECT_EQ(frames, 6u);
  EXPECT_LE(static_cast<double>(frames), 30 * rt::seconds(now() - t0) + 1);
  EXPECT_GE(camera.rendered(), frames);
  EXPECT_GT(camera.twin_cpu_ns(), 0);
  EXPECT_GE(camera.late_max().count(), 0);
  // What arrived is what the on-demand camera makes of the same number.
  SyntheticCamera again(startup.token(), config, world, pose, t0);
  auto g = std::make_unique<RgbdFrame>();
  again.expose(last, *g);
  EXPECT_TRUE(
      std::equal(f->depth_mm.begin(), f->depth_mm.begin() + 512 * 424, g->depth_mm.begin()));
  EXPECT_TRUE(std::equal(f->colour.begin(), f->colour.begin() + 512 * 424, g->colour.begin()));
}

}  // namespace
