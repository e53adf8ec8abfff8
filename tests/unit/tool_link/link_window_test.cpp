// Figures of a window of arrivals, against sums made by hand.
#include "tools/measure/bench/link/link_window.hpp"

#include "tools/measure/bench/link/link_stages.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact {
namespace {

constexpr std::int64_t kMs = 1000000;

tasks::LinkSample sample(double at_ms, double age_ms, bool picture = true,
                         std::uint32_t bytes = 1000) {
  tasks::LinkSample s;
  s.stamp = rt::Time{} + rt::Nanos{static_cast<std::int64_t>(at_ms * 1e6)};
  s.made_remote_ns = static_cast<std::int64_t>((at_ms - age_ms) * 1e6);
  // What the link believes of the clocks is another matter.
  s.made = s.stamp - rt::Nanos{static_cast<std::int64_t>(age_ms * 1e6) + 7 * kMs};
  s.bytes = bytes;
  s.picture = picture;
  return s;
}

TEST(LinkWindow, CountsWhatArrivedInTheSpansAlone) {
  std::vector<tasks::LinkSample> all;
  for (int i = 0; i < 100; ++i) all.push_back(sample(100 * i, i < 90 ? 100 : 300));
  for (int i = 0; i < 100; ++i) all.push_back(sample(100 * i + 1, 50, false, 200));
  all[3].spared = {2, drivers::Spared::Why::kLate};
  all[4].key = true;
  const std::vector<Span_ns> whole{{0, 10000 * kMs}};
  LinkWindow w = link_window(all, whole);
  EXPECT_EQ(w.pictures, 100U);
  EXPECT_EQ(w.states, 100U);
  EXPECT_DOUBLE_EQ(w.fps, 10);
  EXPECT_DOUBLE_EQ(w.mbit_s, 8e-6 * 100 * 1000 / 10);
  EXPECT_NEAR(w.age_p50_ms, 100, 1e-6);
  EXPECT_NEAR(w.age_p95_ms, 300, 1e-6);
  EXPECT_NEAR(w.state_p95_ms, 50, 1e-6);
  EXPECT_DOUBLE_EQ(w.spared_share, 0.01);
  EXPECT_DOUBLE_EQ(w.key_share, 0.01);
  const std::vector<Span_ns> two{{0, 1000 * kMs}, {9000 * kMs, 10000 * kMs}};
  w = link_window(all, two);
  EXPECT_EQ(w.pictures, 20U);
  EXPECT_DOUBLE_EQ(w.seconds, 2);
  EXPECT_DOUBLE_EQ(w.fps, 10);
  const std::vector<Span_ns> nothing{{20000 * kMs, 21000 * kMs}};
  w = link_window(all, nothing);
  EXPECT_EQ(w.fps, 0);
  EXPECT_TRUE(std::isnan(w.age_p95_ms)) << "no picture is not a young picture";
}

TEST(LinkWindow, APictureBeyondTheStallIsSeen) {
  // 12500 bytes take 10 ms at 10 Mbit/s.
  std::vector<tasks::LinkSample> all{sample(10, 100, true, 12500),
                                     sample(500, 400 + 95 + 10 + 20, true, 12500),
                                     sample(600, 9000, false)};
  EXPECT_NEAR(over_stall_ms(all, {0, 1000 * kMs}, 400, 95, 10), 20, 1e-6);
  EXPECT_LT(over_stall_ms(all, {0, 100 * kMs}, 400, 95, 10), 0);
  EXPECT_TRUE(std::isnan(over_stall_ms(all, {700 * kMs, 900 * kMs}, 400, 95, 10)));
}

TEST(LinkWindow, StretchesInWhichTheBaseMoves) {
  std::vector<TruthSample> truth;
  double x = 0;
  // Stands 1 s, drives 2 s at .2 m/s, stands 1 s, turns for 2 s at .4 rad/s, moves a moment.
  for (int i = 0; i <= 400; ++i) {
    const double t = 0.02 * i;
    TruthSample s;
    s.stamp = rt::Time{} + rt::nanos_from_seconds(t);
    if (t > 1 && t <= 3) x += 0.2 * 0.02;
    s.x_m = x + (t > 7.5 && t <= 7.7 ? 0.2 * (t - 7.5) : 0);
    s.yaw_rad = t <= 4 ? 0 : std::min(0.8, 0.4 * (t - 4));
    truth.push_back(s);
  }
  const auto spans = moving_spans(truth, 0.05, 1);
  ASSERT_EQ(spans.size(), 2U);
  EXPECT_NEAR(1e-9 * static_cast<double>(spans[0].from), 1, 0.05);
  EXPECT_NEAR(1e-9 * static_cast<double>(spans[0].to), 3, 0.05);
  EXPECT_NEAR(1e-9 * static_cast<double>(spans[1].from), 4, 0.05);
  EXPECT_NEAR(1e-9 * static_cast<double>(spans[1].to), 6, 0.05);
}

TEST(LinkWindow, HowLongABaseMovesAfterASilence) {
  std::vector<tasks::RobotSample> robot;
  for (int ms = 0; ms < 3000; ms += 10) {
    tasks::RobotSample s;
    s.stamp = rt::Time{} + rt::Nanos{ms * kMs};
    // Drives until 1250, again from 1500.
    s.speed_m_per_s = ms < 1250 || ms >= 1500 ? 0.3F : 0.0F;
    robot.push_back(s);
  }
  const std::vector<std::int64_t> one{1000 * kMs};
  Silence s = after_silences(robot, one, 475);
  EXPECT_EQ(s.driving, 1);
  EXPECT_NEAR(s.stands_ms, 240, 1e-6);
  const std::vector<std::int64_t> standing{1300 * kMs};
  s = after_silences(robot, standing, 475);
  EXPECT_EQ(s.driving, 0) << "it stood before: nothing to stop";
  const std::vector<std::int64_t> both{1000 * kMs, 2000 * kMs};
  s = after_silences(robot, both, 475);
  EXPECT_EQ(s.driving, 2);
  EXPECT_NEAR(s.stands_ms, 470, 1e-6) << "at the second one it never stood";
}

// A sample each 10 ms, a goal each 100 ms. The second goal is the last for 400 ms: the base, at
// 0.3 m/s, stands 250 ms after it. A gap while it stands tells nothing.
TEST(LinkWindow, AGapInTheGoals) {
  std::vector<tasks::RobotSample> robot;
  for (int ms = 0; ms < 2000; ms += 10) {
    tasks::RobotSample s;
    s.stamp = rt::Time{} + rt::Nanos{ms * kMs};
    s.goal_seq = ms < 100    ? 1U
                 : ms < 500  ? 2U
                 : ms < 1000 ? 1U + static_cast<unsigned>(ms) / 100U
                             : 20U;
    s.driving = ms < 1000;
    const bool stands = (ms > 350 && ms < 500) || ms >= 1000;
    s.speed_m_per_s = stands ? 0.0F : 0.3F;
    robot.push_back(s);
  }
  const Silence s = after_gaps(robot, 150);
  EXPECT_EQ(s.driving, 1);
  EXPECT_NEAR(s.stands_ms, 250, 1e-6);
  EXPECT_EQ(after_gaps(robot, 450).driving, 0);
  EXPECT_EQ(after_gaps({}, 150).driving, 0);
}

TEST(LinkWindow, FromTheExposureToTheForceThatKnowsIt) {
  std::vector<tasks::FusionSample> fusion;
  std::vector<tasks::LinkSample> link;
  // At 100, 200, ... ms; of images 60 ms before; every third is not used. The link's measure of the
  // other clock errs, each time by another millisecond.
  for (int i = 0; i < 10; ++i) {
    tasks::FusionSample f;
    f.stamp = rt::Time{} + rt::Nanos{(100 + 100 * i) * kMs};
    f.exposure = f.stamp - rt::Nanos{(60 - i) * kMs};
    f.integrated = i % 3 != 2;
    fusion.push_back(f);
    tasks::LinkSample l;
    l.made = f.exposure;
    link.push_back(l);  // a state of the same instant is no picture
    l.picture = true;
    l.made_remote_ns = rt::ns_of(f.stamp) - 60 * kMs;
    link.push_back(l);
  }
  std::vector<tasks::HapticSample> haptic;
  for (int ms = 0; ms < 1200; ++ms) {
    tasks::HapticSample h;
    h.stamp = rt::Time{} + rt::Nanos{ms * kMs};
    // A patch is in use 20 ms after it was fused.
    const int fused = std::max(0, (ms - 20) / 100 * 100);
    h.patch_age_s = 1e-3F * static_cast<float>(ms - fused);
    h.in_contact = ms >= 300;
    haptic.push_back(h);
  }
  const auto felt = felt_after_ms(haptic, fusion, link);
  // At 300 the patch of 200 is in use; then those of 400, 500, 700, 800 and 1000.
  ASSERT_EQ(felt.size(), 6U);
  EXPECT_NEAR(felt[0], 300 - 140, 1.1);
  for (std::size_t i = 1; i < felt.size(); ++i) EXPECT_NEAR(felt[i], 80, 1.1) << i;
  EXPECT_TRUE(felt_after_ms({}, fusion, link).empty());
  link.resize(10);
  EXPECT_EQ(felt_after_ms(haptic, fusion, link).size(), 3U) << "pictures of 600 ms on are missing";
}

// Images of 33 ms; each takes 12 ms to capture, 7 there, 100 on the road, waits 9, and
// the hand has it 16 ms after fusion began. The link's measure of the robot's clock is 40 ms off.
TEST(LinkWindow, TheStagesOfAnImageAddUpToItsTime) {
  constexpr std::int64_t kOff = 40 * kMs;
  const auto at = [](std::int64_t ns) { return rt::Time{} + rt::Nanos{ns}; };
  std::vector<tasks::FusionSample> fusion;
  std::vector<tasks::HapticSample> haptic;
  std::vector<tasks::LinkSample> link;
  std::vector<rt::JobRecord> capture;
  for (std::uint32_t i = 0; i < 20; ++i) {
    std::int64_t t = (100 + 33 * static_cast<std::int64_t>(i)) * kMs;
    tasks::LinkSample l;
    l.picture = true;
    l.made_remote_ns = t;
    l.made = at(t + kOff);
    l.bytes = 40 + 1000 * (i + 1);
    rt::JobRecord job;
    job.work = 1000 * (i + 1);
    job.start_ns = t += 12 * kMs;
    job.end_ns = t += 7 * kMs;
    capture.push_back(job);
    l.stamp = at(t += 100 * kMs);
    link.push_back(l);
    tasks::FusionSample f;
    f.stamp = at(t += 9 * kMs);
    f.exposure = l.made;
    f.integrated = true;
    fusion.push_back(f);
    tasks::HapticSample h;
    h.stamp = at(t + 16 * kMs);
    h.patch_age_s = 0.016F;
    h.in_contact = true;
    haptic.push_back(h);
  }
  const auto stages = felt_stages({haptic, fusion, link, capture});
  ASSERT_EQ(stages.size(), 20U);
  for (const Stages_ms& ms : stages) EXPECT_EQ(ms, (Stages_ms{12, 7, 100, 9, 16}));
  const auto whole = felt_after_ms(haptic, fusion, link);
  EXPECT_NEAR(whole.back(), 144, 1e-6);
  capture.erase(capture.begin());
  EXPECT_EQ(felt_stages({haptic, fusion, link, capture}).size(), 19U)
      << "a job that is not on record";
}

}  // namespace
}  // namespace teletact
