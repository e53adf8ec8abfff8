// The depth bias table against its closed form, and the thread that grabs from a blocking library.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <thread>

#include "config/schema.hpp"
#include "drivers/camera/camera_choice.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/random.hpp"

namespace drivers {
namespace {

using perception::RgbdFrame;

TEST(DepthBias, LinearBetweenPointsAndFlatBeyond) {
  rt::Startup startup;
  const DepthBias bias(startup.token(), {{1000, -4}, {2000, 6}, {4000, 26}});
  EXPECT_EQ(bias.corrected(1000), 1004);
  EXPECT_EQ(bias.corrected(1500), 1499);  // bias 1
  EXPECT_EQ(bias.corrected(2000), 1994);
  EXPECT_EQ(bias.corrected(3000), 2984);  // bias 16
  EXPECT_EQ(bias.corrected(4000), 3974);
  EXPECT_EQ(bias.corrected(9000), 8974);
  EXPECT_EQ(bias.corrected(500), 504);
  EXPECT_EQ(bias.corrected(0), 0) << "no reading stays none";
  EXPECT_EQ(bias.corrected(65535), 65535);
  EXPECT_EQ(bias.corrected(65534), 65508);
  const DepthBias large(startup.token(), {{1, 900}});
  EXPECT_EQ(large.corrected(700), 1) << "a reading never becomes none";
  const DepthBias none(startup.token(), {});
  for (int r = 0; r < 65536; r += 13) EXPECT_EQ(none.corrected(static_cast<std::uint16_t>(r)), r);
}

// A known bias put on, and taken out again: what is left is rounding and the bias' change over
// itself.
TEST(DepthBias, TakesOutWhatWasPutOn) {
  const std::uint64_t seed = 3;
  std::printf("  seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  rt::Startup startup;
  for (int trial = 0; trial < 50; ++trial) {
    DepthBiasTable table;
    double at = 300;
    for (int n = 0; n < 6; ++n) {
      table.push_back({at, random.uniform(-30, 30)});
      at += random.uniform(400, 1200);
    }
    const DepthBias bias(startup.token(), table);
    for (int k = 0; k < 200; ++k) {
      const std::size_t i = static_cast<std::size_t>(random.uniform(0, 4.999));
      const double f = random.uniform();
      const double reading = std::floor(table[i].at_mm + f * (table[i + 1].at_mm - table[i].at_mm));
      const double g = (reading - table[i].at_mm) / (table[i + 1].at_mm - table[i].at_mm);
      if (g < 0) continue;
      const double truth = reading - ((1 - g) * table[i].bias_mm + g * table[i + 1].bias_mm);
      EXPECT_NEAR(bias.corrected(static_cast<std::uint16_t>(reading)), truth, 0.5 + 1e-9);
    }
  }
}

TEST(DepthBias, ReadingsThatDoNotRiseAreRefused) {
  rt::Startup startup;
  try {
    const DepthBias bias(startup.token(), {{1000, 1}, {1000, 2}});
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find("camera.bias[1].at_mm"), std::string::npos) << e.what();
  }
}

TEST(CameraChoice, FromAFile) {
  CameraChoice choice;
  config::Section root;
  choice.describe(root.section("camera"));
  const auto ok = config::load_text(
      "[camera]\nkind = \"freenect2\"\nlens = { fx_px = 366.5 }\n"
      "[[camera.bias]]\nat_mm = 1000\nbias_mm = -4\n[[camera.bias]]\nat_mm = 2000\nbias_mm = 6\n",
      "scene.toml", root);
  ASSERT_TRUE(ok) << ok.error();
  ASSERT_EQ(choice.bias.size(), 2U);
  EXPECT_EQ(choice.bias[1].bias_mm, 6);
  EXPECT_EQ(choice.intrinsics(), (perception::Intrinsics{366.5, 366.5, 255.5, 211.5, 512, 424}));
  choice.kind = "openni2";
  choice.lens = {};
  choice.lens.width_px = 320, choice.lens.height_px = 240;
  EXPECT_EQ(choice.intrinsics(), (perception::Intrinsics{285.15, 285.15, 159.5, 119.5, 320, 240}));
  const auto bad = config::load_override("camera.kind=\"kinect\"", root);
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().find("freenect2"), std::string::npos) << bad.error();
}

// ---- the thread

class Script final : public FrameSource {
 public:
  explicit Script(CameraStatus last) : last_(last) {}
  perception::Intrinsics intrinsics() const noexcept override { return {100, 100, 3.5, 2.5, 8, 6}; }
  double rate_hz() const noexcept override { return 30; }
  std::string description() const override { return "script"; }
  CameraStatus wait_frame(int, RgbdFrame& out) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    if (n_ == 5) return last_;
    if (n_ == 2 && !paused_) {
      paused_ = true;
      return CameraStatus::kNoFrame;
    }
    out.intrinsics = intrinsics();
    out.has_colour = false;
    out.depth_mm.fill(static_cast<std::uint16_t>(1000 + n_++));
    return CameraStatus::kFrame;
  }

 private:
  CameraStatus last_;
  int n_ = 0;
  bool paused_ = false;
};

TEST(GrabbedCamera, NewestFrameThenTheEnd) {
  for (const CameraStatus last : {CameraStatus::kEnd, CameraStatus::kFault}) {
    rt::Startup startup;
    const auto now = [] { return rt::Time{} + rt::Nanos{5'000'000'000}; };
    std::unique_ptr<Camera> camera = std::make_unique<GrabbedCamera>(
        startup.token(), std::make_unique<Script>(last), now, std::chrono::milliseconds{20});
    camera = without_bias(startup.token(), std::move(camera), {{1000, 4}});
    EXPECT_EQ(camera->intrinsics().width, 8);
    auto frame = std::make_unique<RgbdFrame>();
    int frames = 0;
    std::uint64_t seq = 0;
    CameraStatus status = CameraStatus::kNoFrame;
    while (status != last) {
      status = camera->poll(rt::Time{}, *frame);
      if (status != CameraStatus::kFrame) continue;
      EXPECT_TRUE(frames == 0 || frame->seq > seq);
      seq = frame->seq;
      ++frames;
      EXPECT_EQ(frame->depth_mm[0], 1000 + frame->seq - 4) << "bias taken out";
      EXPECT_EQ(frame->depth_mm[47], frame->depth_mm[0]);
      EXPECT_EQ(frame->exposure, now() - std::chrono::milliseconds{20});
    }
    EXPECT_GE(frames, 1);
    EXPECT_EQ(seq, 4U) << "the last one before the end is handed out";
  }
}

}  // namespace
}  // namespace drivers
