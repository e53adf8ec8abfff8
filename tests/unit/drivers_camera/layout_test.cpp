// Folders of TUM RGB-D and of 7-Scenes as they are downloaded: how images are found and paired,
// which intrinsics count, and that each fault gives one message with its place.
#include "drivers/camera/sequence_layout.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>

#include "drivers/camera/tum_reader.hpp"
#include "rt/random.hpp"
#include "tests/support/tsan_libraries.hpp"
#include "tests/unit/drivers_camera/tum_folder.hpp"

namespace {

namespace fs = std::filesystem;
using camera_test::TumFolder;
using drivers::SequenceLayout;
using drivers::TumOptions;
using drivers::TumSequence;
using perception::RgbdFrame;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string error_of(const std::string& folder, const TumOptions& o = {}) {
  const auto s = TumSequence::open(folder, o);
  return s ? "" : s.error();
}

// As downloaded: no associations.txt, no intrinsics.txt.
void as_tum(const TumFolder& f, const std::string& depth, const std::string& rgb) {
  fs::remove(f.file("associations.txt"));
  fs::remove(f.file("intrinsics.txt"));
  f.write("depth.txt", depth);
  f.write("rgb.txt", rgb);
}
void as_seven_scenes(const TumFolder& f, int frames) {
  fs::remove(f.file("associations.txt"));
  fs::remove(f.file("intrinsics.txt"));
  for (int i = 0; i < frames; ++i) {
    const std::string from = std::to_string(i) + ".png", to = "frame-00000" + std::to_string(i);
    fs::rename(f.file("depth/" + from), f.file(to + ".depth.png"));
    fs::rename(f.file("rgb/" + from), f.file(to + ".color.png"));
  }
}
TumOptions small_pinhole(double units = 0) {
  TumOptions o;
  o.pinhole = {30, 31, 15.5, 11.5, units};
  return o;
}
void write_big(const std::string& file, int type, int value, int width = 640) {
  cv::imwrite(file, cv::Mat(480, width, type, cv::Scalar::all(value)));
}

TEST(Layout, ListsArePairedByTheNearestStamp) {
  const TumFolder f(4);
  as_tum(f,
         "# depth maps\n10.000 depth/0.png\n10.033 depth/1.png\n10.066 depth/2.png\n"
         "10.100 depth/3.png\n",
         "# colour\n9.985 rgb/0.png\n10.031 rgb/1.png\n10.040 rgb/2.png\n10.1201 rgb/3.png\n");
  const auto s = TumSequence::open(f.path(), small_pinhole());
  ASSERT_TRUE(s.has_value()) << s.error();
  ASSERT_EQ(s.value().size(), 2) << "26 ms, and 20.1 ms: too far";
  EXPECT_EQ(s.value().stamp_text(0), "10.000");
  EXPECT_EQ(s.value().stamp_text(1), "10.033");
  ASSERT_EQ(s.value().assumed().size(), 1u);
  EXPECT_THAT(s.value().assumed()[0], HasSubstr("2 depth images have no colour image"));
  auto frame = std::make_unique<RgbdFrame>();
  ASSERT_TRUE(s.value().read(1, *frame).has_value());
  EXPECT_EQ(frame->rgb().at(5, 5).r, 31) << "10.031, not 10.040";
  EXPECT_EQ(frame->depth().at(10, 0), 140) << "700 at 5000 a metre, the layout's unit";
  // Without colour every depth image counts and rgb.txt is not asked for.
  fs::remove(f.file("rgb.txt"));
  TumOptions depth_only = small_pinhole();
  depth_only.skip_colour = true;
  EXPECT_EQ(TumSequence::open(f.path(), depth_only).value().size(), 4);
}

// Against every pair looked at.
TEST(Layout, PairingIsThatOfBruteForce) {
  const std::uint64_t seed = 9;
  rt::Random random(seed);
  const TumFolder f(1);
  for (int run = 0; run < 20; ++run) {
    std::vector<double> depth, colour;
    const auto list = [&](std::vector<double>& stamps, const char* file) {
      std::string text;
      double t = random.uniform(0, 0.03);
      for (int i = 0; i < 60; ++i, t += random.uniform(0.001, 0.06)) {
        char line[64];
        std::snprintf(line, sizeof line, "%.4f", t);
        stamps.push_back(std::stod(line));
        text.append(line).append(" ").append(file).append("\n");
      }
      return text;
    };
    const std::string depth_text = list(depth, "depth/0.png"), rgb = list(colour, "rgb/0.png");
    as_tum(f, depth_text, rgb);
    const auto layout = drivers::find_images(f.path(), true);
    ASSERT_TRUE(layout.has_value()) << layout.error();
    std::vector<double> expected, found;
    for (const double d : depth) {
      double nearest = 1e9;
      for (const double c : colour) nearest = std::min(nearest, std::abs(c - d));
      if (nearest <= 0.020 + 1e-6) expected.push_back(d);
    }
    for (const auto& image : layout.value().images) found.push_back(image.depth_s);
    EXPECT_EQ(found, expected) << "run " << run << ", seed " << seed;
    EXPECT_EQ(layout.value().left_out, static_cast<int>(60 - expected.size()));
  }
}

TEST(Layout, FramesOf7ScenesAreNumbered) {
  const TumFolder f(3);
  as_seven_scenes(f, 3);
  f.write("frame-000000.pose.txt", "not looked at");
  f.write("frame-0001.depth.png", "another name");
  const auto s = TumSequence::open(f.path(), small_pinhole());
  ASSERT_TRUE(s.has_value()) << s.error();
  ASSERT_EQ(s.value().size(), 3);
  EXPECT_EQ(s.value().stamp_text(2), "0.066667");
  EXPECT_NEAR(s.value().stamp_s(2), 2.0 / 30, 1e-12);
  auto frame = std::make_unique<RgbdFrame>();
  ASSERT_TRUE(s.value().read(2, *frame).has_value());
  EXPECT_FALSE(frame->has_colour) << "not registered, and registering was not asked for";
  for (int v = 0; v < 24; ++v) {
    for (int u = 0; u < 32; ++u) {
      const int raw = TumFolder::value(2, u, v);
      ASSERT_EQ(frame->depth().at(u, v), raw == 65535 ? 0 : raw) << "millimetres, 65535 invalid";
    }
  }
  TumOptions registered = small_pinhole();
  registered.register_colour = true;
  const auto r = TumSequence::open(f.path(), registered);
  ASSERT_TRUE(r.has_value()) << r.error();
  EXPECT_THAT(r.value().assumed(), ElementsAre(HasSubstr("RedKitchen")));
}

TEST(Layout, IntrinsicsAreTheFilesThenTheOptionsThenTheDataSets) {
  {
    const TumFolder f(1);
    EXPECT_THAT(error_of(f.path(), small_pinhole()),
                AllOf(HasSubstr("intrinsics.txt: is there"), HasSubstr("without")));
  }
  {
    const TumFolder f(1);
    as_tum(f, "1 depth/0.png\n", "1 rgb/0.png\n");
    EXPECT_THAT(error_of(f.path()), AllOf(HasSubstr("intrinsics.txt"), HasSubstr("32 x 24")));
    const auto s = TumSequence::open(f.path(), small_pinhole(2000));
    ASSERT_TRUE(s.has_value()) << s.error();
    EXPECT_EQ(s.value().intrinsics(), (perception::Intrinsics{30, 31, 15.5, 11.5, 32, 24}));
    EXPECT_EQ(s.value().depth_units_per_metre(), 2000);
    EXPECT_THAT(s.value().assumed(), IsEmpty());
    write_big(f.file("depth/0.png"), CV_16UC1, 5000);
    write_big(f.file("rgb/0.png"), CV_8UC3, 9);
    const auto big = TumSequence::open(f.path());
    ASSERT_TRUE(big.has_value()) << big.error();
    EXPECT_EQ(big.value().intrinsics(), (perception::Intrinsics{525, 525, 319.5, 239.5, 640, 480}));
    EXPECT_EQ(big.value().depth_units_per_metre(), 5000);
    EXPECT_THAT(big.value().assumed(), ElementsAre(AllOf(HasSubstr("no intrinsics.txt"),
                                                         HasSubstr("525,525,319.5,239.5 px"))));
    auto frame = std::make_unique<RgbdFrame>();
    ASSERT_TRUE(big.value().read(0, *frame).has_value());
    EXPECT_EQ(frame->depth().at(100, 100), 1000);
    write_big(f.file("depth/0.png"), CV_16UC1, 5000, 700);
    EXPECT_THAT(error_of(f.path()), HasSubstr("700 x 480, the largest image is 640 x 480"));
  }
  {
    const TumFolder f(1);
    as_seven_scenes(f, 1);
    write_big(f.file("frame-000000.depth.png"), CV_16UC1, 1234);
    write_big(f.file("frame-000000.color.png"), CV_8UC3, 9);
    const auto s = TumSequence::open(f.path());
    ASSERT_TRUE(s.has_value()) << s.error();
    EXPECT_EQ(s.value().intrinsics(), (perception::Intrinsics{585, 585, 320, 240, 640, 480}));
    EXPECT_EQ(s.value().depth_units_per_metre(), 1000);
  }
}

TEST(Layout, FaultsAreNamedWithTheirPlace) {
  const struct {
    const char *depth, *rgb, *place, *why;
  } cases[] = {
      {"1 depth/0.png 3\n", "1 rgb/0.png\n", "depth.txt:1", "wanted 't file', found 3"},
      {"1 depth/0.png\n\n1 depth/1.png\n", "1 rgb/0.png\n", "depth.txt:3", "does not rise"},
      {"1 depth/0.png\n", "x rgb/0.png\n", "rgb.txt:1", "not a finite number: 'x'"},
      {"1 depth/9.png\n", "1 rgb/0.png\n", "depth.txt:1", "depth/9.png"},
      {"1 depth/0.png\n", "1 rgb/9.png\n", "rgb.txt:1", "rgb/9.png"},
      {"9e9 depth/0.png\n", "1 rgb/0.png\n", "depth.txt:1", "outside -4e9"},
      {"# none\n", "1 rgb/0.png\n", "depth.txt", "lists no image"},
      {"1 depth/0.png\n", "2 rgb/0.png\n", "rgb.txt", "within 20 ms"},
  };
  for (const auto& c : cases) {
    const TumFolder f(2);
    as_tum(f, c.depth, c.rgb);
    EXPECT_THAT(error_of(f.path(), small_pinhole()),
                AllOf(HasSubstr(f.file(c.place)), HasSubstr(c.why)));
  }
  {
    const TumFolder f(2);
    as_tum(f, "1 depth/0.png\n", "");
    fs::remove(f.file("rgb.txt"));
    EXPECT_THAT(error_of(f.path(), small_pinhole()), HasSubstr(f.file("rgb.txt")));
  }
  {
    const TumFolder f(2);
    as_seven_scenes(f, 2);
    fs::remove(f.file("frame-000001.color.png"));
    EXPECT_THAT(error_of(f.path(), small_pinhole()),
                HasSubstr(f.file("frame-000001.color.png") + ": is not there"));
  }
  {
    const TumFolder f(1);
    fs::remove(f.file("associations.txt"));
    EXPECT_THAT(error_of(f.path()), AllOf(HasSubstr(f.path()), HasSubstr("neither")));
    fs::remove(f.file("intrinsics.txt"));
    EXPECT_THAT(error_of(f.path()), HasSubstr("neither associations.txt"));
  }
}

}  // namespace
