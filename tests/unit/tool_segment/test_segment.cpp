// teletact segment as a user calls it: masks, the same bytes, bad input; the image readers fuzzed.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <span>
#include <sstream>

#include "rt/random.hpp"
#include "tools/files/image_files.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
constexpr int kW = 96, kH = 72;

std::string slurp(const fs::path& p) {
  std::ifstream in(p, std::ios::binary);
  std::stringstream s;
  s << in.rdbuf();
  return s.str();
}

class Segment : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() /
            ("teletact_segment_" + std::to_string(getpid()) + "_" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(root_);
    rt::Random random(4);
    cv::Mat colour(kH, kW, CV_8UC3), depth(kH, kW, CV_16UC1);
    for (int v = 0; v < kH; ++v) {
      for (int u = 0; u < kW; ++u) {
        const bool box = u >= 30 && u < 60 && v >= 20 && v < 50;
        const int n = static_cast<int>(random.integer(-4, 4));
        colour.at<cv::Vec3b>(v, u) = box ? cv::Vec3b(static_cast<std::uint8_t>(40 + n), 60, 190)
                                         : cv::Vec3b(150, static_cast<std::uint8_t>(160 + n), 150);
        depth.at<std::uint16_t>(v, u) =
            static_cast<std::uint16_t>((box ? 800 : 1000) + random.integer(-1, 1));
      }
    }
    cv::imwrite(path("c.png"), colour);
    cv::imwrite(path("c.jpg"), colour);
    cv::imwrite(path("d.png"), depth);
    cv::imwrite(path("small.png"), cv::Mat(kH / 2, kW, CV_16UC1, cv::Scalar(900)));
    cv::imwrite(path("empty.png"), cv::Mat(kH, kW, CV_16UC1, cv::Scalar(0)));
  }
  void TearDown() override { fs::remove_all(root_); }

  std::string path(const std::string& name) const { return (root_ / name).string(); }
  // Throws what the program prints; otherwise the exit code.
  int run(const std::vector<std::string>& args) const {
    std::vector<std::string> all{"segment"};
    all.insert(all.end(), args.begin(), args.end());
    std::vector<char*> argv;
    for (auto& a : all) argv.push_back(a.data());
    return teletact::cmd_segment(static_cast<int>(argv.size()), argv.data());
  }
  std::string refusal(const std::vector<std::string>& args) const {
    try {
      run(args);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  }
  std::vector<std::string> with_depth(std::vector<std::string> more) const {
    std::vector<std::string> a{"--color",      path("c.png"), "--depth", path("d.png"),
                               "--intrinsics", "90,90,48,36", "--out",   path("m.png")};
    a.insert(a.end(), more.begin(), more.end());
    return a;
  }
  fs::path root_;
};

TEST_F(Segment, TouchedPixelInMaskBothMethodsWithAndWithoutDepth) {
  for (const std::string method : {"default", "paper"}) {
    for (const bool depth : {false, true}) {
      std::vector<std::string> args =
          depth ? with_depth({})
                : std::vector<std::string>{"--color", path("c.jpg"), "--out", path("m.png")};
      for (const std::string a :
           {"--method", method.c_str(), "--touch", "45,35", "--touch", "5,5"}) {
        args.push_back(a);
      }
      ASSERT_EQ(run(args), 0);
      const cv::Mat m = cv::imread(path("m.png"), cv::IMREAD_UNCHANGED);
      ASSERT_EQ(m.type(), CV_8UC1);
      EXPECT_EQ(m.at<std::uint8_t>(35, 45), 1);
      EXPECT_EQ(m.at<std::uint8_t>(5, 5), 2);
      int right = 0;
      for (int v = 0; v < kH; ++v) {
        for (int u = 0; u < kW; ++u) {
          right += (m.at<std::uint8_t>(v, u) == 1) == (u >= 30 && u < 60 && v >= 20 && v < 50);
        }
      }
      EXPECT_GT(right, kW * kH * 93 / 100) << method << depth;
      const std::string first = slurp(path("m.png"));
      fs::remove(path("m.png"));
      ASSERT_EQ(run(args), 0);
      EXPECT_EQ(slurp(path("m.png")), first);
    }
  }
}

TEST_F(Segment, WholeAndJson) {
  ASSERT_EQ(
      run({"--color", path("c.png"), "--whole", "--out", path("l.png"), "--json", path("l.json")}),
      0);
  const cv::Mat m = cv::imread(path("l.png"), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(m.cols, kW);
  EXPECT_NE(m.at<std::uint8_t>(35, 45), m.at<std::uint8_t>(5, 5));
  EXPECT_GT(m.at<std::uint8_t>(0, 0), 0);
  EXPECT_NE(slurp(path("l.json")).find("segment.regions"), std::string::npos);
  ASSERT_EQ(run(with_depth({"--touch", "45,35", "--json", path("o.json")})), 0);
  const std::string json = slurp(path("o.json"));
  for (const char* key :
       {"object_1.centroid_z_m", "object_1.extent_x_m", "object_1.qw", "object_1.colour"}) {
    EXPECT_NE(json.find(key), std::string::npos) << key;
  }
}

// Parts of equal label, 4-neighbours.
int connected_parts(const cv::Mat& labels) {
  cv::Mat left = labels.clone();
  int parts = 0;
  for (int v = 0; v < left.rows; ++v) {
    for (int u = 0; u < left.cols; ++u) {
      const int label = left.at<std::uint8_t>(v, u);
      if (label == 0) continue;
      ++parts;
      cv::floodFill(left, {u, v}, 0, nullptr, 0, 0, 4);
    }
  }
  return parts;
}

// A JPEG with an EXIF segment (APP1) that holds the orientation alone.
std::vector<std::uint8_t> held(const cv::Mat& image, std::uint8_t orientation) {
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", image, jpeg, {cv::IMWRITE_JPEG_QUALITY, 100});
  const std::vector<std::uint8_t> exif{
      0xFF, 0xE1,        0x00, 0x22, 'E', 'x', 'i', 'f', 0,
      0,    'I',         'I',  42,   0,   8,   0,   0,   0,  // TIFF head
      1,    0,           0x12, 0x01, 3,   0,   1,   0,   0,
      0,    orientation, 0,    0,    0,   0,   0,   0,   0};  // one entry
  jpeg.insert(jpeg.begin() + 2, exif.begin(), exif.end());
  return jpeg;
}

// Each orientation of the standard (EXIF 2.3, tag 0x0112), by where its pixels lie.
TEST_F(Segment, APhotographStandsAsItWasHeld) {
  cv::Mat image(kH, kW, CV_8UC3);
  for (int v = 0; v < kH; ++v)
    for (int u = 0; u < kW; ++u)
      image.at<cv::Vec3b>(v, u) =
          cv::Vec3b(40, static_cast<std::uint8_t>(2 * u), static_cast<std::uint8_t>(3 * v));
  for (std::uint8_t orientation = 1; orientation <= 8; ++orientation) {
    const auto bytes = held(image, orientation);
    const auto stored = teletact::decode_colour(bytes, "x");
    const auto upright = teletact::decode_colour(bytes, "x", teletact::Orientation::kUpright);
    ASSERT_TRUE(stored) << stored.error();
    ASSERT_TRUE(upright) << upright.error();
    const auto& s = stored.value();
    const auto& r = upright.value();
    const bool swapped = orientation >= 5;
    ASSERT_EQ(r.width(), swapped ? kH : kW) << int{orientation};
    ASSERT_EQ(r.height(), swapped ? kW : kH);
    int wrong = 0;
    for (int v = 0; v < r.height(); ++v) {
      for (int u = 0; u < r.width(); ++u) {
        const int right = r.width() - 1 - u, below = r.height() - 1 - v;
        const int us[] = {u, right, right, u, v, v, below, below};
        const int vs[] = {v, v, below, below, u, right, right, u};
        wrong += s.at(us[orientation - 1], vs[orientation - 1]) == r.at(u, v) ? 0 : 1;
      }
    }
    EXPECT_EQ(wrong, 0) << "orientation " << int{orientation};
  }
}

// Upside down it has the depth image's size, and is not of its pixels.
TEST_F(Segment, ATurnedPhotographBesideADepthImageIsRefused) {
  const auto bytes = held(cv::imread(path("c.png")), 3);
  std::ofstream(path("turned.jpg"), std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  auto args = with_depth({"--touch", "45,35"});
  std::ranges::replace(args, path("c.png"), path("turned.jpg"));
  EXPECT_NE(refusal(args).find("EXIF orientation"), std::string::npos) << refusal(args);
}

TEST_F(Segment, WholeWithDepthPartsWhatColourDoesNot) {
  // One colour; a box in front of a wall, and a strip without a reading.
  cv::Mat depth(kH, kW, CV_16UC1);
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const bool box = u >= 30 && u < 60 && v >= 20 && v < 50;
      depth.at<std::uint16_t>(v, u) = u >= 88 ? 0 : box ? 800 : 1000;
    }
  }
  cv::imwrite(path("d.png"), depth);
  cv::imwrite(path("c.png"), cv::Mat(kH, kW, CV_8UC3, cv::Scalar(120, 130, 140)));
  const auto args = with_depth({"--whole", "--json", path("l.json")});
  ASSERT_EQ(run(args), 0);
  const std::string first = slurp(path("m.png"));
  const cv::Mat m = cv::imread(path("m.png"), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(m.type(), CV_8UC1);
  const int on_box = m.at<std::uint8_t>(35, 45), on_wall = m.at<std::uint8_t>(5, 5);
  EXPECT_NE(on_box, on_wall);
  int right = 0;
  for (int v = 20; v < 50; ++v)
    for (int u = 30; u < 60; ++u) right += m.at<std::uint8_t>(v, u) == on_box ? 1 : 0;
  const int all = cv::countNonZero(m == on_box);
  EXPECT_GE(right, 0.97 * 900) << "of the box";
  EXPECT_LE(all, 1.03 * 900);
  double least = 0, most = 0;
  cv::minMaxLoc(m, &least, &most);
  EXPECT_EQ(least, 1);
  EXPECT_EQ(connected_parts(m), static_cast<int>(most)) << "each label is one 4-connected part";
  ASSERT_EQ(run(args), 0);
  EXPECT_EQ(slurp(path("m.png")), first);
}

TEST_F(Segment, WholeWithDepthOfAnything) {
  const std::uint64_t seed = 5;
  rt::Random random(seed);
  for (int round = 0; round < 12; ++round) {
    const int w = static_cast<int>(random.integer(2, 90)),
              h = static_cast<int>(random.integer(2, 70));
    cv::Mat colour(h, w, CV_8UC3), depth(h, w, CV_16UC1);
    const int kind = static_cast<int>(random.integer(0, 3));  // noise, none, tiles, saturated
    for (int v = 0; v < h; ++v) {
      for (int u = 0; u < w; ++u) {
        const int tile = (u / 13 * 31 + v / 9 * 17) % 7;
        const auto n = static_cast<std::uint8_t>(kind == 0 ? random.integer(0, 255) : 30 * tile);
        colour.at<cv::Vec3b>(v, u) = cv::Vec3b(n, static_cast<std::uint8_t>(255 - n), 90);
        depth.at<std::uint16_t>(v, u) =
            static_cast<std::uint16_t>(kind == 0   ? random.integer(0, 65535)
                                       : kind == 1 ? 0
                                       : kind == 2 ? 500 + 150 * tile
                                                   : 65535);
      }
    }
    cv::imwrite(path("c.png"), colour);
    cv::imwrite(path("d.png"), depth);
    const auto args = with_depth({"--whole"});
    if (kind == 1 || kind == 3) {
      EXPECT_THROW(run(args), std::runtime_error) << "no reading";
      continue;
    }
    ASSERT_EQ(run(args), 0) << "seed " << seed << ", round " << round;
    const std::string first = slurp(path("m.png"));
    cv::Mat m = cv::imread(path("m.png"), cv::IMREAD_UNCHANGED);
    double least = 0, most = 0;
    cv::minMaxLoc(m, &least, &most);
    EXPECT_GE(least, 1);
    if (m.type() == CV_8UC1) {
      EXPECT_EQ(connected_parts(m), static_cast<int>(most))
          << "seed " << seed << ", round " << round;
    }
    ASSERT_EQ(run(args), 0);
    EXPECT_EQ(slurp(path("m.png")), first) << "seed " << seed << ", round " << round;
  }
}

TEST_F(Segment, AnAlphaChannelIsDropped) {
  const cv::Mat colour = cv::imread(path("c.png"));
  cv::Mat with_alpha(kH, kW, CV_8UC4);
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const auto c = colour.at<cv::Vec3b>(v, u);
      with_alpha.at<cv::Vec4b>(v, u) = {c[0], c[1], c[2], static_cast<std::uint8_t>(u % 2 * 200)};
    }
  }
  cv::imwrite(path("rgba.png"), with_alpha);
  const auto mask_of = [&](const std::string& file) {
    EXPECT_EQ(run({"--color", path(file), "--touch", "45,35", "--out", path("m.png")}), 0);
    return slurp(path("m.png"));
  };
  EXPECT_EQ(mask_of("rgba.png"), mask_of("c.png"));
}

TEST_F(Segment, OfPlaceAgainstColourOnlyMOverGCounts) {
  const auto pixels = [&](const std::vector<std::string>& more, bool depth) {
    std::vector<std::string> args =
        depth ? with_depth({})
              : std::vector<std::string>{"--color", path("c.png"), "--out", path("m.png")};
    args.insert(args.end(), {"--method", "paper", "--touch", "5,5", "--threshold", "25"});
    args.insert(args.end(), more.begin(), more.end());
    EXPECT_EQ(run(args), 0);
    return std::pair(slurp(path("m.png")),
                     cv::countNonZero(cv::imread(path("m.png"), cv::IMREAD_UNCHANGED)));
  };
  for (const bool depth : {false, true}) {
    const std::string unit = depth ? "60" : "20", twice = depth ? "120" : "40";
    const auto usual = pixels({}, depth), same = pixels({"--m", "20", "--g", twice}, depth);
    EXPECT_EQ(usual.first, pixels({"--g", unit}, depth).first) << "the default";
    EXPECT_EQ(usual.first, same.first) << "m / g";
    EXPECT_LT(pixels({"--g", depth ? "6" : "2"}, depth).second, usual.second / 2);
  }
  EXPECT_THROW(run(with_depth({"--method", "paper", "--touch", "5,5", "--g", "0"})),
               std::exception);
}

// The same PNG announced twice as high: each chunk is whole, the data end too early.
std::string png_of_half_its_rows(std::string png) {
  const std::size_t height = 8 + 8 + 4, crc = 8 + 8 + 13;
  png[height + 3] = static_cast<char>(2 * kH);
  const std::span<const std::uint8_t> body(reinterpret_cast<const std::uint8_t*>(&png[12]), 17);
  for (std::size_t i = 0; i < 4; ++i)
    png[crc + i] = static_cast<char>(drivers::png_crc(body) >> (24 - 8 * i));
  return png;
}

TEST_F(Segment, BadInputIsOneMessageAndNoFile) {
  std::ofstream(path("text.png")) << "not an image";
  const std::string whole = slurp(path("c.png"));
  std::ofstream(path("torn.png"), std::ios::binary) << whole.substr(0, whole.size() / 2);
  const std::string jpg = slurp(path("c.jpg"));
  std::ofstream(path("torn.jpg"), std::ios::binary) << jpg.substr(0, jpg.size() / 2);
  std::ofstream(path("none.png"));
  std::ofstream(path("half.png"), std::ios::binary) << png_of_half_its_rows(whole);
  // Zeros in the middle of its data: libjpeg makes an image of it, and says so.
  std::string damaged = jpg;
  std::fill_n(damaged.begin() + static_cast<std::ptrdiff_t>(jpg.size() / 2), jpg.size() / 8, '\0');
  std::ofstream(path("damaged.jpg"), std::ios::binary) << damaged;
  fs::create_directories(path("folder.png"));
  const std::string c = path("c.png"), d = path("d.png"), out = path("m.png"), k = "90,90,48,36";
  const std::vector<std::vector<std::string>> bad{
      {"--color", path("absent.png"), "--touch", "1,1"},
      {"--color", path("text.png"), "--touch", "1,1"},
      {"--color", path("torn.png"), "--touch", "1,1"},
      {"--color", path("torn.jpg"), "--touch", "1,1"},
      {"--color", path("none.png"), "--touch", "1,1"},
      {"--color", path("half.png"), "--touch", "1,1"},
      {"--color", path("damaged.jpg"), "--touch", "1,1"},
      {"--color", path("folder.png"), "--touch", "1,1"},
      {"--color", d, "--touch", "1,1"},
      {"--color", c},
      {"--color", c, "--whole", "--touch", "1,1"},
      {"--color", c, "--whole", "--method", "paper"},
      {"--color", c, "--whole", "--depth", d},
      {"--color", c, "--whole", "--depth", path("small.png"), "--intrinsics", k},
      {"--color", c, "--touch", "96,10"},
      {"--color", c, "--touch", "10,72"},
      {"--color", c, "--touch", "-1,10"},
      {"--color", c, "--touch", "1.5,10"},
      {"--color", c, "--touch", "nan,10"},
      {"--color", c, "--touch", "10"},
      {"--color", c, "--touch", "10,10,10"},
      {"--color", c, "--touch", "1,1", "--method", "other"},
      {"--color", c, "--touch", "1,1", "--depth", d},
      {"--color", c, "--touch", "1,1", "--intrinsics", k},
      {"--color", c, "--touch", "1,1", "--depth", d, "--intrinsics", "0,90,48,36"},
      {"--color", c, "--touch", "1,1", "--depth", d, "--intrinsics", "90,90,48"},
      {"--color", c, "--touch", "1,1", "--depth", c, "--intrinsics", k},
      {"--color", c, "--touch", "1,1", "--depth", path("small.png"), "--intrinsics", k},
      {"--color", c, "--touch", "1,1", "--depth", path("empty.png"), "--intrinsics", k, "--method",
       "paper"},
      {"--color", c, "--touch", "1,1", "--no-such-option"},
  };
  for (auto args : bad) {
    args.insert(args.end(), {"--out", out});
    std::string shown;
    for (const auto& a : args) shown += " " + a;
    ::testing::internal::CaptureStderr();
    try {
      run(args);
      ADD_FAILURE() << "accepted:" << shown;
    } catch (const std::exception& e) {
      EXPECT_GT(std::string(e.what()).size(), 10U) << shown;
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << shown;
    }
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "") << "beside the message:" << shown;
    EXPECT_FALSE(fs::exists(out)) << shown;
  }
  EXPECT_THROW(run({"--color", c, "--touch", "1,1", "--out", path("no/such/folder.png")}),
               std::runtime_error);
}

TEST_F(Segment, DepthWithoutAReadingIsRefused) {
  cv::imwrite(path("full.png"), cv::Mat(kH, kW, CV_16UC1, cv::Scalar(65535)));
  for (const char* depth : {"empty.png", "full.png"}) {
    for (const std::vector<std::string>& how : std::vector<std::vector<std::string>>{
             {"--touch", "45,35"}, {"--touch", "45,35", "--method", "paper"}, {"--whole"}}) {
      auto args = with_depth(how);
      args[3] = path(depth);
      const std::string said = refusal(args);
      EXPECT_NE(said.find(depth), std::string::npos) << said;
      EXPECT_NE(said.find("holds no reading"), std::string::npos) << said;
      EXPECT_FALSE(fs::exists(path("m.png")));
    }
  }
}

TEST_F(Segment, OptionsWithoutEffectAreRefused) {
  for (const std::vector<std::string>& option :
       std::vector<std::vector<std::string>>{{"--m", "10"}, {"--g", "40"}, {"--threshold", "25"}}) {
    auto args = with_depth({"--whole"});
    args.insert(args.end(), option.begin(), option.end());
    EXPECT_EQ(refusal(args), option[0] + " has no meaning with --whole");
  }
  EXPECT_EQ(refusal(with_depth({"--touch", "45,35", "--threshold", "25"})),
            "--threshold has no meaning with --method default: it belongs to --method paper");
  EXPECT_EQ(refusal({"--color", path("c.png"), "--touch", "45,35", "--depth-unit", "2", "--out",
                     path("m.png")}),
            "--depth-unit has no meaning without --depth");
  EXPECT_FALSE(fs::exists(path("m.png")));
}

// Every reader on damaged files: an error or an image of sane size, never a fault.
TEST_F(Segment, ReadersOnDamagedFiles) {
  const std::uint64_t seed = 99;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  int images = 0;
  for (const char* file : {"c.png", "c.jpg", "d.png"}) {
    const std::string whole = slurp(path(file));
    for (int round = 0; round < 1500; ++round) {
      std::vector<std::uint8_t> bytes(whole.begin(), whole.end());
      const int edits = static_cast<int>(random.integer(1, 6));
      for (int e = 0; e < edits; ++e) {
        const auto at = static_cast<std::size_t>(
            random.integer(0, static_cast<std::int64_t>(bytes.size()) - 1));
        switch (random.integer(0, 3)) {
          case 0:
            bytes[at] = static_cast<std::uint8_t>(random());
            break;
          case 1:
            bytes[at] ^= static_cast<std::uint8_t>(1U << (random() & 7U));
            break;
          case 2:
            bytes.resize(at + 1);
            break;
          default:
            bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                         static_cast<std::uint8_t>(random()));
            break;
        }
      }
      const auto colour = teletact::decode_colour(bytes, "fuzz");
      const auto grey = teletact::decode_grey(bytes, "fuzz");
      for (const auto* error :
           {colour ? nullptr : &colour.error(), grey ? nullptr : &grey.error()}) {
        if (error != nullptr) {
          ASSERT_EQ(error->rfind("fuzz: ", 0), 0U);
        }
      }
      if (colour) {
        ++images;
        ASSERT_LE(colour.value().width(), teletact::kMaxImageSide);
      }
    }
  }
  EXPECT_GT(images, 0);  // some damage in a JPEG's data is not visible in its container
}

}  // namespace
