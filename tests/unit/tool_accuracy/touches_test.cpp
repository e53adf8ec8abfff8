// Folders of images with true masks: which of them the bench takes, and with what intrinsics.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "rt/random.hpp"
#include "tools/measure/bench/table2/touches.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

class Touches : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("teletact_touches_" + std::to_string(getpid()));
    fs::create_directories(root_);
  }
  void TearDown() override { fs::remove_all(root_); }

  // A table seen from above at 1 m, a box of 10 cm on it; depth in `units` a metre.
  void write_scene(const std::string& name, double units, const char* colour_ending = ".png") {
    for (const char* part : {"rgb", "depth", "label"}) fs::create_directories(root_ / name / part);
    constexpr int kW = 160, kH = 120;
    rt::Random random(8);
    cv::Mat colour(kH, kW, CV_8UC3), depth(kH, kW, CV_16UC1), label(kH, kW, CV_16UC1);
    for (int v = 0; v < kH; ++v) {
      for (int u = 0; u < kW; ++u) {
        const bool box = u >= 60 && u < 100 && v >= 45 && v < 80;
        const auto n = static_cast<std::uint8_t>(random.integer(0, 6));
        colour.at<cv::Vec3b>(v, u) = box ? cv::Vec3b(40, 60, static_cast<std::uint8_t>(190 + n))
                                         : cv::Vec3b(150, static_cast<std::uint8_t>(160 + n), 150);
        const double m = (box ? 0.9 : 1.0) + 0.0005 * random.uniform(-1, 1);
        depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(m * units + 0.5);
        label.at<std::uint16_t>(v, u) = box ? 7 : 0;
      }
    }
    cv::imwrite((root_ / name / "rgb" / (std::string("0") + colour_ending)).string(), colour);
    cv::imwrite((root_ / name / "depth" / "0.png").string(), depth);
    cv::imwrite((root_ / name / "label" / "0.png").string(), label);
  }
  void write_intrinsics(const std::string& name, const std::string& text) {
    std::ofstream(root_ / name / "intrinsics.txt") << text << "\n";
  }
  TouchResult bench(const std::string& folder) {
    said_.str("");
    return bench_touches(said_, folder, 3, {}, true);
  }
  fs::path root_;
  std::ostringstream said_;
};

TEST_F(Touches, AnyFolderWithIntrinsicsIsTaken) {
  write_scene("desk 2", 1000);
  write_intrinsics("desk 2", "150 150 79.5 59.5 160 120 1000");
  write_scene("fine", 10000, ".jpg");  // tenths of a millimetre
  write_intrinsics("fine", "150 150 79.5 59.5 160 120 10000");
  write_scene("unknown", 1000);
  fs::create_directories(root_ / "notes");
  std::ofstream(root_ / "README") << "a file";
  const TouchResult all = bench(root_.string());
  ASSERT_EQ(all.rows.size(), 2u);
  EXPECT_EQ(all.rows[0].folder, "desk 2");
  EXPECT_EQ(all.rows[0].name(), "desk_2");
  EXPECT_EQ(all.rows[1].folder, "fine");
  for (const TouchRow& row : all.rows) {
    EXPECT_EQ(row.frames, 1);
    EXPECT_EQ(row.objects, 1);
    EXPECT_GT(row.iou_default, 0.9) << row.folder << ": the depth's unit counts";
  }
  EXPECT_THAT(said_.str(), HasSubstr("unknown: no intrinsics.txt"));
  EXPECT_THAT(said_.str(), HasSubstr("notes: holds no folder rgb"));
  EXPECT_THAT(said_.str(), Not(HasSubstr("README")));
}

TEST_F(Touches, OneFolderAlone) {
  write_scene("desk", 1000);
  write_intrinsics("desk", "150 150 79.5 59.5 160 120 1000");
  for (const char* ending : {"desk", "desk/", "desk/../desk/."}) {
    const TouchResult one = bench((root_ / ending).string());
    ASSERT_EQ(one.rows.size(), 1u) << ending;
    EXPECT_EQ(one.rows[0].folder, "desk") << ending;
  }
}

TEST_F(Touches, FaultsAreNamed) {
  const auto refused = [&](const std::string& folder, const char* why) {
    try {
      static_cast<void>(bench(folder));
      ADD_FAILURE() << "accepted " << folder;
    } catch (const std::runtime_error& e) {
      EXPECT_THAT(e.what(), HasSubstr(why));
    }
  };
  refused(root_.string(), "intrinsics.txt");
  refused((root_ / "nothing").string(), "nothing");
  write_scene("desk", 1000);
  refused((root_ / "desk").string(), "intrinsics.txt");
  write_intrinsics("desk", "150 150 79.5 59.5 160 120");
  refused((root_ / "desk").string(), "intrinsics.txt:1: wanted 7 numbers");
  write_intrinsics("desk", "150 150 79.5 59.5 320 240 1000");
  refused((root_ / "desk").string(), "must be 320 x 240");
}

}  // namespace
}  // namespace teletact
