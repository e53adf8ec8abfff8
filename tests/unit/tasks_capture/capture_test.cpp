// CaptureTask: levels, faults, and what the JPEG library allocates in a job.
#include "tasks/capture/capture_task.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/support/tsan_libraries.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using drivers::EncodedFrame;
using perception::RgbdFrame;
using tasks::CaptureTask;

rt::Startup startup;

class Capture : public ::testing::Test {
 protected:
  Capture() {
    frame->intrinsics = {365, 365, 255.5, 211.5, 512, 424};
    frame->has_colour = true;
    rt::Random rng(1);
    for (auto& d : frame->depth_mm) d = static_cast<std::uint16_t>(1500 + 3 * rng.normal());
    for (std::size_t i = 0; i < frame->colour.size(); ++i) {
      frame->colour[i] = {static_cast<std::uint8_t>(i / 512),
                          static_cast<std::uint8_t>(i % 512 / 2), 80};
    }
  }
  rt::Health step(int level = 0, bool fresh = true) {
    rt::Tick tick;
    tick.level = level;
    out.slot = slot.get();
    rt::Section section;
    return task.step(tick, {frame.get(), fresh}, out);
  }
  CaptureTask task{startup.token(), {}};
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
  std::unique_ptr<EncodedFrame> slot = std::make_unique<EncodedFrame>();
  CaptureTask::Out out;
};

TEST_F(Capture, EncodesAFreshFrameAndNothingElse) {
  EXPECT_EQ(step(0, false), rt::Health::ok());
  EXPECT_FALSE(out.written);
  rt::Tick tick;
  EXPECT_EQ(task.step(tick, {nullptr, true}, out), rt::Health::ok());
  EXPECT_FALSE(out.written);
  EXPECT_EQ(task.stats().idle, 2u);
  frame->seq = 7;
  EXPECT_EQ(step(), rt::Health::ok());
  EXPECT_TRUE(out.written);
  EXPECT_EQ(slot->seq, 7u);
  EXPECT_TRUE(slot->has_colour);
  EXPECT_EQ(slot->exposure.box, rt::Box::kRobot);
  // The bytes are a frame.
  drivers::FrameCodecScratch scratch(startup.token(), {});
  auto back = std::make_unique<RgbdFrame>();
  ASSERT_EQ(drivers::decode(*slot, rt::Time{}, scratch, *back), drivers::FrameStatus::kOk);
  EXPECT_TRUE(std::equal(frame->depth_mm.begin(), frame->depth_mm.begin() + 512 * 424,
                         back->depth_mm.begin()));
}

TEST_F(Capture, LevelOneHasColourInEveryThirdFrame) {
  std::string with;
  for (std::uint64_t seq = 0; seq < 9; ++seq) {
    frame->seq = seq;
    ASSERT_EQ(step(1), rt::Health::ok());
    ASSERT_TRUE(out.written);
    with += slot->has_colour ? 'c' : '.';
  }
  EXPECT_EQ(with, "c..c..c..");
  EXPECT_EQ(task.stats().colour_coded, 3u);
  EXPECT_EQ(task.stats().frames, 9u);
}

TEST_F(Capture, DepthOnlyCameraIsNoFault) {
  frame->has_colour = false;
  EXPECT_EQ(step(), rt::Health::ok());
  EXPECT_TRUE(out.written);
  EXPECT_FALSE(slot->has_colour);
  EXPECT_EQ(task.stats().colour_coded, 0u);
}

TEST_F(Capture, BadFrameIsCountedAndNotSent) {
  frame->intrinsics.width = 5000;
  const auto health = step();
  EXPECT_EQ(health.severity, rt::Severity::kCounted);
  EXPECT_EQ(health.fault, tasks::kFaultCaptureBadFrame);
  EXPECT_FALSE(out.written);
  frame->intrinsics = {std::nan(""), 365, 255, 211, 512, 424};
  EXPECT_EQ(step().fault, tasks::kFaultCaptureBadFrame);
  EXPECT_EQ(task.stats().bad_frames, 2u);
}

TEST_F(Capture, ColourThatDoesNotFitIsLeftOutAndReported) {
  CaptureTask full(startup.token(), {.colour = {.quality = 100, .half = false}});
  rt::Random rng(2);
  for (auto& c : frame->colour) {
    const auto bits = rng();
    c = {static_cast<std::uint8_t>(bits), static_cast<std::uint8_t>(bits >> 8U),
         static_cast<std::uint8_t>(bits >> 16U)};
  }
  out.slot = slot.get();
  const auto health = full.step({}, {frame.get(), true}, out);
  EXPECT_EQ(health.fault, tasks::kFaultCaptureNoColour);
  EXPECT_TRUE(out.written);
  EXPECT_FALSE(slot->has_colour);
  EXPECT_EQ(full.stats().colour_failed, 1u);
}

TEST_F(Capture, OurOwnCodeAllocatesNothingAndTheLibrarysShareIsPrinted) {
  // No step before: what the library sets up at its first use was the constructor's business.
  frame->seq = 1;
  rt_guard::reset();
  ASSERT_EQ(step(1), rt::Health::ok());  // depth only
  EXPECT_EQ(rt_guard::counts().total(), 0u);
  rt_guard::reset();
  ASSERT_EQ(step(0), rt::Health::ok());
  if (rt_guard::linked()) {
    const auto c = rt_guard::counts();
    std::printf(
        "  JPEG library in one job: %lu allocations, %lu frees, %lu locks, %lu waits, %lu throws\n",
        c.allocations, c.frees, c.locks, c.waits, c.throws);
    EXPECT_GT(c.allocations, 0u);  // the guard sees into the library
    EXPECT_LE(c.allocations, 100u);
    EXPECT_EQ(c.locks, 0u);
    EXPECT_EQ(c.waits, 0u);
    EXPECT_EQ(c.throws, 0u);
  }
}

// A codec that needs its previous frame: capture encodes what is asked for, once.
struct OnDemand : ::testing::Test {
  static tasks::CaptureConfig config(const char* depth) {
    tasks::CaptureConfig c;
    c.pictures.depth_codec = depth;
    return c;
  }
  OnDemand() {
    frame->intrinsics = {60, 60, 15.5, 11.5, 32, 24};
    std::fill_n(frame->depth_mm.begin(), 32 * 24, std::uint16_t{1500});
  }
  bool step(std::uint64_t seq, bool fresh, std::uint64_t asked, std::uint64_t answered,
            bool key = false) {
    frame->seq = seq;
    demand = {asked, rt::Time{}, 0, 0, static_cast<std::uint8_t>(key ? 1 : 0)};
    out.slot = slot.get();
    tasks::CaptureTask::In in{frame.get(), fresh, asked > 0 ? &demand : nullptr, answered};
    rt::Section section;
    EXPECT_EQ(task.step({}, in, out), rt::Health::ok());
    return out.written;
  }
  rt::Startup startup;
  CaptureTask task{
      startup.token(), config("faithful"), rt::Box::kRobot, {60, 60, 15.5, 11.5, 32, 24}};
  drivers::FrameDemand demand;
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
  std::unique_ptr<EncodedFrame> slot = std::make_unique<EncodedFrame>();
  CaptureTask::Out out;
};

TEST_F(OnDemand, ADemandIsAnsweredOnceByTheNewestFrame) {
  EXPECT_FALSE(step(1, true, 0, 0)) << "nobody asked";
  EXPECT_FALSE(step(2, true, 0, 0));
  EXPECT_EQ(task.stats().unasked, 1U) << "the second took the place of the first";
  EXPECT_TRUE(step(2, false, 1, 0)) << "it was waiting";
  EXPECT_EQ(slot->seq, 2U);
  EXPECT_EQ(slot->demand, 1U);
  EXPECT_FALSE(slot->needs_previous) << "the first of all";
  EXPECT_FALSE(step(3, true, 1, 1)) << "answered";
  EXPECT_TRUE(step(4, true, 2, 1));
  EXPECT_EQ(slot->demand, 2U);
  EXPECT_FALSE(step(4, false, 3, 2)) << "there is no newer frame";
  EXPECT_TRUE(step(5, true, 3, 2, true));
  EXPECT_FALSE(slot->needs_previous) << "a key was asked for";
  EXPECT_EQ(task.stats().frames, 3U);
  EXPECT_EQ(task.stats().unasked, 2U);
}

TEST_F(OnDemand, WhatWasNotPublishedIsFollowedByAKey) {
  ASSERT_TRUE(step(1, true, 1, 0));
  ASSERT_TRUE(step(2, true, 2, 1));
  task.lost();
  ASSERT_TRUE(step(3, true, 2, 1));
  EXPECT_FALSE(slot->needs_previous);
}

TEST_F(OnDemand, AFrameOfAnotherSizeIsCountedAndNotEncoded) {
  frame->intrinsics.width = 30;
  frame->seq = 1;
  demand = {1, rt::Time{}, 0, 0, 0};
  out.slot = slot.get();
  EXPECT_EQ(task.step({}, {frame.get(), true, &demand, 0}, out).fault,
            tasks::kFaultCaptureBadFrame);
  EXPECT_FALSE(out.written);
}

TEST(CaptureConfig, KeysAreDescribed) {
  tasks::CaptureConfig c;
  config::Section root;
  c.describe(root.section("capture"));
  ASSERT_TRUE(
      config::load_text("[capture.colour]\nquality = 75\nhalf = false\n", "t", root).has_value());
  EXPECT_EQ(c.colour.quality, 75);
  EXPECT_FALSE(c.colour.half);
  tasks::CaptureConfig d;
  config::Section other;
  d.describe(other.section("capture"));
  EXPECT_FALSE(config::load_text("[capture.colour]\nquality = 0\n", "t", other).has_value());
}

}  // namespace
