// teletact codec on a small recording: what was decoded is a recording again, lossless is exact,
// modes keep their bound, a rate is kept, bad input is one error and leaves nothing behind.
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"
#include "drivers/codec/depth_stream.hpp"
#include "drivers/codec/rate_steps.hpp"
#include "rt/random.hpp"
#include "tools/files/csv.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
using drivers::DepthMode;

constexpr int kWidth = 96, kHeight = 72, kFrames = 8;

class Codec : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() /
            ("teletact_codec_" + std::to_string(getpid()) + "_" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(root_ / "seq" / "depth");
    fs::create_directories(root_ / "seq" / "rgb");
    std::printf("  seed 4\n");
    rt::Random random(4);
    std::ofstream list(root_ / "seq" / "associations.txt"),
        poses(root_ / "seq" / "groundtruth.txt");
    for (int i = 0; i < kFrames; ++i) {
      cv::Mat depth(kHeight, kWidth, CV_16UC1), colour(kHeight, kWidth, CV_8UC3);
      for (int v = 0; v < kHeight; ++v) {
        for (int u = 0; u < kWidth; ++u) {
          const bool hole = (u + v + i) % 17 == 0;
          const double mm = (u < 40 ? 900 + 2 * v : 1700 + u) + 1.5 * random.normal();
          depth.at<std::uint16_t>(v, u) = hole ? std::uint16_t{0} : static_cast<std::uint16_t>(mm);
          colour.at<cv::Vec3b>(v, u) = {static_cast<std::uint8_t>(2 * u + 1),
                                        static_cast<std::uint8_t>(3 * v + 1), 90};
        }
      }
      const std::string d = "depth/" + std::to_string(i) + ".png",
                        c = "rgb/" + std::to_string(i) + ".png",
                        t = "12.0" + std::to_string(i) + "50";
      cv::imwrite((root_ / "seq" / d).string(), depth);
      cv::imwrite((root_ / "seq" / c).string(), colour);
      list << t << ' ' << c << ' ' << t << ' ' << d << '\n';
      poses << t << " 0 0 " << 0.01 * i << " 0 0 0 1\n";
    }
    std::ofstream(root_ / "seq" / "intrinsics.txt")
        << "80 80 47.5 35.5 " << kWidth << ' ' << kHeight << " 1000\n";
  }
  void TearDown() override { fs::remove_all(root_); }

  int codec(const std::vector<std::string>& extra, const std::string& out = "out") {
    std::vector<std::string> args{"codec", "--rgbd", (root_ / "seq").string(), "--out",
                                  (root_ / out).string()};
    args.insert(args.end(), extra.begin(), extra.end());
    std::vector<char*> argv;
    for (auto& a : args) argv.push_back(a.data());
    return teletact::cmd_codec(static_cast<int>(argv.size()), argv.data());
  }
  std::string refusal(const std::vector<std::string>& extra, const std::string& out = "out") {
    try {
      static_cast<void>(codec(extra, out));
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  }
  // Stamps that pause for a minute in the middle.
  void pause() const {
    std::ofstream list(root_ / "seq" / "associations.txt");
    for (int i = 0; i < kFrames; ++i) {
      const std::string n = std::to_string(i) + ".png",
                        t = std::to_string(i < kFrames / 2 ? 12 : 72) + ".0" + std::to_string(i);
      list << t << " rgb/" << n << ' ' << t << " depth/" << n << '\n';
    }
  }
  std::unique_ptr<perception::RgbdFrame> frame(const std::string& folder, int i) {
    const auto sequence = drivers::TumSequence::open((root_ / folder).string());
    EXPECT_TRUE(sequence) << (sequence ? "" : sequence.error());
    auto out = std::make_unique<perception::RgbdFrame>();
    EXPECT_TRUE(sequence.value().read(i, *out));
    EXPECT_EQ(sequence.value().size(), kFrames);
    return out;
  }
  fs::path root_;
};

TEST_F(Codec, LosslessDepthComesBackExactly) {
  ASSERT_EQ(codec({"--mode", "lossless"}), 0);
  const auto a = drivers::TumSequence::open((root_ / "seq").string()),
             b = drivers::TumSequence::open((root_ / "out").string());
  ASSERT_TRUE(a && b);
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_EQ(a.value().stamp_text(i), b.value().stamp_text(i));
    const auto in = frame("seq", i), out = frame("out", i);
    EXPECT_EQ(in->depth_mm, out->depth_mm);
    EXPECT_TRUE(out->has_colour);
    EXPECT_EQ(in->intrinsics.fx, out->intrinsics.fx);
    double off = 0;
    for (std::size_t n = 0; n < std::size_t{kWidth} * kHeight; ++n)
      off += std::abs(in->colour[n].r - out->colour[n].r);
    EXPECT_LT(off / (kWidth * kHeight), 12);
  }
  std::ifstream poses(root_ / "out" / "groundtruth.txt");
  EXPECT_TRUE(poses.good());
}

TEST_F(Codec, EachModeKeepsItsBoundAndItsHoles) {
  for (const DepthMode mode : {DepthMode::kFaithful, DepthMode::kQuiet, DepthMode::kMoving}) {
    const std::string name = to_text(mode);
    ASSERT_EQ(codec({"--mode", name, "--colour", "none"}, name), 0);
    for (int i = 0; i < kFrames; ++i) {
      const auto in = frame("seq", i), out = frame(name, i);
      for (std::size_t n = 0; n < std::size_t{kWidth} * kHeight; ++n) {
        const int x = in->depth_mm[n], y = out->depth_mm[n];
        ASSERT_EQ(x == 0, y == 0) << name << " frame " << i << " pixel " << n;
        ASSERT_LE(std::abs(x - y), depth_error_bound_mm(drivers::DepthNoiseLaw::kStrict, mode,
                                                        drivers::default_depth_step(
                                                            mode, drivers::DepthNoiseLaw::kStrict),
                                                        in->depth_mm[n]));
      }
    }
  }
}

TEST_F(Codec, TheTableHasARowAFrame) {
  ASSERT_EQ(codec({"--mode", "faithful", "--json", (root_ / "f.json").string()}), 0);
  const auto table = teletact::read_csv((root_ / "out" / "codec.csv").string());
  ASSERT_TRUE(table) << table.error();
  ASSERT_EQ(table.value().rows.size(), std::size_t{kFrames});
  const auto cell = [&](std::size_t row, const char* name) {
    return table.value().rows[row][static_cast<std::size_t>(table.value().column(name))];
  };
  EXPECT_EQ(cell(0, "kind"), to_text(drivers::DepthFrameKind::kKey));
  for (std::size_t i = 0; i < kFrames; ++i)
    EXPECT_EQ(std::stoi(cell(i, "bytes")),
              std::stoi(cell(i, "depth_bytes")) + std::stoi(cell(i, "colour_bytes")));
  EXPECT_TRUE(fs::exists(root_ / "f.json"));
}

TEST_F(Codec, SaysWhereTheRateIsNotReached) {
  const auto fps_in_rate = [&](const char* rate, const std::string& out) {
    testing::internal::CaptureStdout();
    const std::string json = (root_ / (out + ".json")).string();
    EXPECT_EQ(codec({"--mode", "moving", "--rate", rate, "--colour", "none", "--json", json}, out),
              0);
    const bool said =
        testing::internal::GetCapturedStdout().find("was not reached") != std::string::npos;
    std::stringstream text;
    text << std::ifstream(json).rdbuf();
    const auto at = text.str().find("codec.fps_in_rate");
    EXPECT_NE(at, std::string::npos) << text.str();
    const auto value = text.str().find("\"value\":", at);
    EXPECT_NE(value, std::string::npos) << text.str();
    return std::pair{std::stod(text.str().substr(value + 8)), said};
  };
  // Stamps are 10 ms apart. No step makes such frames so small.
  const auto [few, said] = fps_in_rate("0.1", "few");
  EXPECT_GT(few, 0);
  EXPECT_LT(few, 50);
  EXPECT_TRUE(said);
  const auto [all, also_said] = fps_in_rate("500", "all");
  EXPECT_NEAR(all, 100, 1);
  EXPECT_FALSE(also_said);
  // A pause of the recording is no slow camera.
  pause();
  const auto [paused, paused_said] = fps_in_rate("500", "paused");
  EXPECT_NEAR(paused, 100, 1);
  EXPECT_FALSE(paused_said);
}

TEST_F(Codec, RefusesWhatItCanNotDoAndLeavesNothing) {
  fs::create_directories(root_ / "full");
  std::ofstream(root_ / "full" / "keep.txt") << "mine";
  EXPECT_NE(refusal({"--mode", "quiet"}, "full").find("not empty"), std::string::npos);
  EXPECT_TRUE(fs::exists(root_ / "full" / "keep.txt"));
  EXPECT_NE(refusal({"--mode", "quiet"}, "seq").find("not empty"), std::string::npos);
  EXPECT_NE(refusal({"--mode", "swift"}), "");
  EXPECT_NE(refusal({"--mode", "quiet", "--rate", "nan"}), "");
  EXPECT_NE(refusal({"--mode", "quiet", "--rate", "-1"}), "");
  EXPECT_NE(refusal({"--mode", "quiet", "--rgbd", (root_ / "none").string()}), "");
  // A frame that can not be read, behind some that could.
  std::ofstream(root_ / "seq" / "depth" / "5.png") << "no image";
  EXPECT_NE(refusal({"--mode", "quiet"}).find("5.png"), std::string::npos);
  EXPECT_FALSE(fs::exists(root_ / "out"));
  fs::create_directories(root_ / "empty");
  EXPECT_NE(refusal({"--mode", "quiet"}, "empty"), "");
  EXPECT_TRUE(fs::is_empty(root_ / "empty"));
}

// Sizes of a codec whose frames lose a tenth a step: the mean keeps to the share, and what is spare
// is used.
TEST(RateSteps, KeepsToTheShareAndComesBack) {
  drivers::RateSteps steps(1, 1, 7);
  const auto size = [](int step) { return static_cast<std::int64_t>(50000 * std::pow(0.9, step)); };
  std::int64_t sum = 0;
  for (int i = 0; i < 200; ++i) {
    const std::int64_t bytes = size(steps.step());
    if (i >= 100) sum += bytes;
    steps.sent(bytes, 36000);
  }
  EXPECT_LE(sum / 100, 36000);
  EXPECT_GE(sum / 100, 25000);
  for (int i = 0; i < 200; ++i) steps.sent(size(steps.step()) / 3, 36000);
  EXPECT_EQ(steps.step(), 1);
  for (int i = 0; i < 200; ++i) steps.sent(1000000, 36000);
  EXPECT_EQ(steps.step(), 7);
  for (int i = 0; i < 50; ++i) steps.sent(1000000, 0);
  EXPECT_EQ(steps.step(), 7);
}

}  // namespace
