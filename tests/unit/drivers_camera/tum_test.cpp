// The TUM reader: what it reads, and that each fault of a folder gives one message with its place.
#include "drivers/camera/tum_reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>

#include "drivers/camera/recorded_camera.hpp"
#include "perception/geometry/no_colour.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/tsan_libraries.hpp"
#include "tests/unit/drivers_camera/scene.hpp"
#include "tests/unit/drivers_camera/tum_folder.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using camera_test::TumFolder;
using drivers::CameraStatus;
using drivers::TumOptions;
using drivers::TumSequence;
using perception::RgbdFrame;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string open_error(const TumFolder& f, const TumOptions& o = {}) {
  const auto s = TumSequence::open(f.path(), o);
  return s ? "" : s.error();
}
std::string read_error(const TumFolder& f, int i, const TumOptions& o = {}) {
  const auto s = TumSequence::open(f.path(), o);
  EXPECT_TRUE(s.has_value()) << (s ? "" : s.error());
  auto frame = std::make_unique<RgbdFrame>();
  const auto ok = s.value().read(i, *frame);
  return ok ? "" : ok.error();
}

TEST(Tum, ReadsWhatWasWritten) {
  const TumFolder folder;
  const auto s = TumSequence::open(folder.path());
  ASSERT_TRUE(s.has_value()) << s.error();
  EXPECT_EQ(s.value().size(), 5);
  EXPECT_EQ(s.value().intrinsics(), (perception::Intrinsics{30, 31, 15.5, 11.5, 32, 24}));
  EXPECT_EQ(s.value().stamp_text(1), "100.033333");
  auto f = std::make_unique<RgbdFrame>();
  ASSERT_TRUE(s.value().read(2, *f).has_value());
  EXPECT_EQ(f->seq, 2u);
  EXPECT_EQ(rt::ns_of(f->exposure), 100066667000);
  ASSERT_TRUE(f->has_colour);
  EXPECT_EQ(f->rgb().at(5, 5), (perception::Rgb{32, 20, 10}));
  for (int v = 0; v < 24; ++v) {
    for (int u = 0; u < 32; ++u) {
      const int raw = TumFolder::value(2, u, v);
      ASSERT_EQ(f->depth().at(u, v), raw == 65535 ? 0 : raw);
    }
  }
}

TEST(Tum, OtherDepthUnits) {
  const TumFolder folder;
  folder.write("intrinsics.txt", "30 30 15 11 32 24 5000\n");
  const auto s = TumSequence::open(folder.path());
  ASSERT_TRUE(s.has_value()) << s.error();
  auto f = std::make_unique<RgbdFrame>();
  ASSERT_TRUE(s.value().read(0, *f).has_value());
  EXPECT_EQ(f->depth().at(10, 0), 120);  // 600 / 5000 m
}

TEST(Tum, FaultsOfTheFolderAreNamedWithTheirPlace) {
  {
    const auto s = TumSequence::open("/nowhere/at/all");
    ASSERT_FALSE(s.has_value());
    EXPECT_THAT(s.error(), AllOf(HasSubstr("/nowhere/at/all/intrinsics.txt"), HasSubstr("opened")));
  }
  const struct {
    const char *file, *text, *place, *why;
  } cases[] = {
      {"intrinsics.txt", "30 30 15 11 32 24\n", "intrinsics.txt:1", "wanted 7"},
      {"intrinsics.txt", "30 x 15 11 32 24 1000\n", "intrinsics.txt:1",
       "fy is not a finite number: 'x'"},
      {"intrinsics.txt", "nan 30 15 11 32 24 1000\n", "intrinsics.txt:1", "fx"},
      {"intrinsics.txt", "30 30 15 11 3200 24 1000\n", "intrinsics.txt:1", "width = 3200"},
      {"intrinsics.txt", "30 30 15 11 32.5 24 1000\n", "intrinsics.txt:1", "not whole"},
      {"intrinsics.txt", "30 30 15 11 32 24 0\n", "intrinsics.txt:1", "units_per_metre"},
      {"intrinsics.txt", "# nothing\n", "intrinsics.txt", "no line"},
      {"intrinsics.txt", "30 30 15 11 32 24 1000\n30 30 15 11 32 24 1000\n", "intrinsics.txt:2",
       "second"},
      {"associations.txt", "# nothing\n", "associations.txt", "no frame"},
      {"associations.txt", "1 rgb/0.png 1\n", "associations.txt:1", "found 3"},
      {"associations.txt", "#\n1 rgb/0.png 1s depth/0.png\n", "associations.txt:2",
       "depth stamp is not a finite number: '1s'"},
      {"associations.txt", "1 rgb/0.png 1 depth/0.png\n1 rgb/1.png 1 depth/1.png\n",
       "associations.txt:2", "does not rise"},
      {"associations.txt", "1 rgb/0.png 1 depth/99.png\n", "associations.txt:1", "depth/99.png"},
      {"associations.txt", "1 rgb/99.png 1 depth/0.png\n", "associations.txt:1", "rgb/99.png"},
      {"associations.txt", "1 rgb/0.png 1 depth\n", "associations.txt:1", "no such file"},
      {"colour_registration.txt", "fx 30\n", "colour_registration.txt", "must all be there"},
      {"colour_registration.txt", "fx 30\nfoo 1\n", "colour_registration.txt:2",
       "unknown key 'foo'"},
      {"colour_registration.txt", "R 1 0 0 0 1 0 0 0\n", "colour_registration.txt:1", "wants 9"},
      {"colour_registration.txt", "R 1 0 0 0 2 0 0 0 1\n", "colour_registration.txt:1", "rotation"},
  };
  for (const auto& c : cases) {
    const TumFolder folder;
    folder.write(c.file, c.text);
    EXPECT_THAT(open_error(folder), AllOf(HasSubstr(folder.file(c.place)), HasSubstr(c.why)));
  }
}

TEST(Tum, FaultsOfAnImageAreNamed) {
  {
    const TumFolder f;
    f.write("depth/1.png", "this is no image");
    EXPECT_THAT(read_error(f, 1),
                AllOf(HasSubstr(f.file("depth/1.png")), HasSubstr("neither a PNG nor")));
  }
  {
    const TumFolder f;
    f.write("depth/1.png", "");
    EXPECT_THAT(read_error(f, 1), AllOf(HasSubstr("depth/1.png"), HasSubstr("empty")));
  }
  {
    const TumFolder f;
    cv::imwrite(f.file("depth/1.png"), cv::Mat(24, 32, CV_8UC1, cv::Scalar(1)));
    EXPECT_THAT(read_error(f, 1), AllOf(HasSubstr("8 bit x 1"), HasSubstr("16 bit x 1")));
  }
  {
    const TumFolder f;
    cv::imwrite(f.file("depth/1.png"), cv::Mat(20, 30, CV_16UC1, cv::Scalar(1)));
    EXPECT_THAT(read_error(f, 1), AllOf(HasSubstr("30 x 20"), HasSubstr("32 x 24")));
  }
  {
    const TumFolder f;
    cv::imwrite(f.file("rgb/2.png"), cv::Mat(20, 30, CV_8UC3, cv::Scalar(1)));
    EXPECT_THAT(read_error(f, 2), HasSubstr("rgb/2.png"));
    EXPECT_EQ(read_error(f, 2, {.skip_colour = true}), "");
  }
  {
    const TumFolder f;
    EXPECT_THAT(read_error(f, 5), HasSubstr("frame 5 is outside 0 ... 4"));
    EXPECT_THAT(read_error(f, -1), HasSubstr("frame -1"));
    EXPECT_THAT(open_error(f, {.to_512x424 = true}), HasSubstr("32 x 24"));
  }
}

// A registered colour image: the colour camera stands 10 cm to the right; a near square hides part
// of the wall from it.
TEST(Tum, RegistrationLooksColourUpAndLeavesItOutWhereItIsHidden) {
  const TumFolder f(1);
  cv::Mat depth(24, 32, CV_16UC1, cv::Scalar(2000));
  for (int v = 8; v < 16; ++v) {
    for (int u = 10; u < 20; ++u) depth.at<std::uint16_t>(v, u) = 500;
  }
  cv::Mat colour(24, 32, CV_8UC3);
  for (int v = 0; v < 24; ++v) {
    for (int u = 0; u < 32; ++u)
      colour.at<cv::Vec3b>(v, u) =
          cv::Vec3b(0, static_cast<std::uint8_t>(v), static_cast<std::uint8_t>(u));
  }
  cv::imwrite(f.file("depth/0.png"), depth);
  cv::imwrite(f.file("rgb/0.png"), colour);
  f.write("intrinsics.txt", "30 30 15.5 11.5 32 24 1000\n");
  f.write("colour_registration.txt",
          "fx 30\nfy 30\ncx 15.5\ncy 11.5\nR 1 0 0 0 1 0 0 0 1\nt -0.1 0 0\n");
  auto frame = std::make_unique<RgbdFrame>();
  const auto plain = TumSequence::open(f.path());
  ASSERT_TRUE(plain.value().read(0, *frame).has_value());
  EXPECT_FALSE(frame->has_colour);
  const auto s = TumSequence::open(f.path(), {.register_colour = true});
  ASSERT_TRUE(s.value().read(0, *frame).has_value());
  ASSERT_TRUE(frame->has_colour);
  // Shift: 30 * 0.1 / z = 6 px at 0.5 m, 1.5 px at 2 m.
  EXPECT_EQ(frame->rgb().at(15, 12), (perception::Rgb{9, 12, 0}));
  EXPECT_EQ(frame->rgb().at(25, 12).g, 12);
  EXPECT_NEAR(frame->rgb().at(25, 12).r, 23.5, 0.51);
  // The wall just left of the square is behind it for the colour camera.
  EXPECT_EQ(frame->rgb().at(8, 12), perception::kNoColour);
  EXPECT_NE(frame->rgb().at(3, 12), perception::Rgb{});
  EXPECT_NE(frame->rgb().at(22, 12), perception::Rgb{});
}

// Black in the file is a colour; what lies outside the colour image and what has no reading has
// none.
TEST(Tum, BlackInTheFileIsAColour) {
  const TumFolder f(1);
  cv::imwrite(f.file("depth/0.png"), cv::Mat(24, 32, CV_16UC1, cv::Scalar(1000)));
  cv::imwrite(f.file("rgb/0.png"), cv::Mat(24, 32, CV_8UC3, cv::Scalar(0, 0, 0)));
  auto frame = std::make_unique<RgbdFrame>();
  const auto lacking = [&] {
    int n = 0;
    for (int v = 0; v < 24; ++v)
      for (int u = 0; u < 32; ++u) n += perception::has_colour(frame->rgb().at(u, v)) ? 0 : 1;
    return n;
  };
  const auto plain = TumSequence::open(f.path());
  ASSERT_TRUE(plain.value().read(0, *frame).has_value());
  ASSERT_TRUE(frame->has_colour);
  EXPECT_EQ(lacking(), 0);
  EXPECT_EQ(frame->rgb().at(0, 0), perception::kBlack);
  // 31 px of focal length, 20 cm to the right: 6 columns at 1 m are left of the colour image.
  f.write("colour_registration.txt",
          "fx 30\nfy 31\ncx 15.5\ncy 11.5\nR 1 0 0 0 1 0 0 0 1\nt -0.2 0 0\n");
  const auto s = TumSequence::open(f.path(), {.register_colour = true});
  ASSERT_TRUE(s.value().read(0, *frame).has_value());
  EXPECT_EQ(lacking(), 6 * 24);
  EXPECT_EQ(frame->rgb().at(5, 3), perception::kNoColour);
  EXPECT_EQ(frame->rgb().at(6, 3), perception::kBlack);
}

// ---- replay ----------------------------------------------------------------------------------

TEST(Replay, PlaysAtItsStampsHoldsTheLastFrameAndEnds) {
  const TumFolder folder(5, 0.04);
  const auto s = TumSequence::open(folder.path());
  const rt::Time start = rt::time_from_ns(7'000'000'000);
  int calls = 0;
  drivers::RecordedCamera camera(camera_test::startup.token(), s.value(), start, 0.2,
                                 [&calls](int, int) { ++calls; });
  EXPECT_EQ(calls, 5);
  EXPECT_NEAR(camera.rate_hz(), 25, 1e-6);
  auto f = std::make_unique<RgbdFrame>();
  EXPECT_EQ(camera.poll(start - std::chrono::milliseconds(1), *f), CameraStatus::kNoFrame);
  std::vector<std::uint64_t> seqs;
  std::vector<std::int64_t> exposures_ms;
  CameraStatus last = CameraStatus::kNoFrame;
  rt_guard::reset();
  seqs.reserve(100), exposures_ms.reserve(100);
  {
    rt::Section section;
    for (int ms = 0; ms <= 400; ++ms) {
      last = camera.poll(start + std::chrono::milliseconds(ms), *f);
      if (last != CameraStatus::kFrame) continue;
      seqs.push_back(f->seq);
      exposures_ms.push_back((f->exposure - start).count() / 1000000);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
  EXPECT_EQ(seqs, (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}));
  EXPECT_EQ(exposures_ms,
            (std::vector<std::int64_t>{0, 40, 80, 120, 160, 193, 226, 260, 293, 326, 360}));
  EXPECT_EQ(f->depth().at(10, 3), TumFolder::value(4, 10, 3));  // the last picture, held
  EXPECT_EQ(last, CameraStatus::kEnd);
  EXPECT_EQ(camera.poll(start + std::chrono::seconds(100), *f), CameraStatus::kEnd);
}

TEST(Replay, SlowReaderGetsTheNewest) {
  const TumFolder folder(5, 0.04);
  const auto s = TumSequence::open(folder.path());
  drivers::RecordedCamera camera(camera_test::startup.token(), s.value(), rt::Time{}, 0);
  auto f = std::make_unique<RgbdFrame>();
  ASSERT_EQ(camera.poll(rt::Time{} + std::chrono::milliseconds(95), *f), CameraStatus::kFrame);
  EXPECT_EQ(f->seq, 2u);
  EXPECT_EQ(camera.poll(rt::Time{} + std::chrono::milliseconds(96), *f), CameraStatus::kNoFrame);
  // Even a reader that comes after the end gets the last frame once.
  ASSERT_EQ(camera.poll(rt::Time{} + std::chrono::seconds(9), *f), CameraStatus::kFrame);
  EXPECT_EQ(f->seq, 4u);
  EXPECT_EQ(camera.poll(rt::Time{} + std::chrono::seconds(9), *f), CameraStatus::kEnd);
}

TEST(Replay, ABadImageStopsTheConstructor) {
  const TumFolder folder;
  folder.write("depth/3.png", "x");
  const auto s = TumSequence::open(folder.path());
  try {
    drivers::RecordedCamera camera(camera_test::startup.token(), s.value(), rt::Time{}, 0);
    FAIL() << "not refused";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("depth/3.png"));
  }
}

// ---- the real recording ----------------------------------------------------------------------

std::string kitchen() { return tests::in_tree("../shared/data/rgbd/7scenes_redkitchen"); }

TEST(RealRecording, OpensAndReads) {
  if (!std::filesystem::exists(kitchen())) GTEST_SKIP() << kitchen() << " is not there";
  const auto s = TumSequence::open(kitchen());
  ASSERT_TRUE(s.has_value()) << s.error();
  ASSERT_EQ(s.value().size(), 150);
  auto f = std::make_unique<RgbdFrame>();
  for (const int i : {0, 75, 149}) {
    ASSERT_TRUE(s.value().read(i, *f).has_value());
    EXPECT_FALSE(f->has_colour);  // it is not registered
    int valid = 0, plausible = 0;
    for (int p = 0; p < 640 * 480; ++p) {
      const int mm = f->depth_mm[static_cast<std::size_t>(p)];
      valid += mm != 0;
      plausible += mm > 400 && mm < 8000;
    }
    EXPECT_NEAR(valid / (640.0 * 480), 0.89, 0.06);
    EXPECT_GT(plausible, valid * 0.99);
  }
}

TEST(RealRecording, ResampledGeometryIsTheSameScene) {
  if (!std::filesystem::exists(kitchen())) GTEST_SKIP() << kitchen() << " is not there";
  const auto full = TumSequence::open(kitchen());
  const auto small = TumSequence::open(kitchen(), {.register_colour = true, .to_512x424 = true});
  ASSERT_TRUE(small.has_value()) << small.error();
  const auto& k = small.value().intrinsics();
  EXPECT_NEAR(k.fx, 516.75, 1e-9);
  EXPECT_NEAR(k.cx, 256.61, 0.005);
  EXPECT_NEAR(k.cy, 211.94, 0.005);
  auto a = std::make_unique<RgbdFrame>(), b = std::make_unique<RgbdFrame>();
  ASSERT_TRUE(full.value().read(10, *a).has_value());
  ASSERT_TRUE(small.value().read(10, *b).has_value());
  EXPECT_TRUE(b->has_colour);
  // Each small pixel's ray hits the full image within half a pixel of the pixel it copied.
  for (int v = 0; v < k.height; v += 7) {
    for (int u = 0; u < k.width; u += 7) {
      const auto at = a->intrinsics.project(k.unproject(u, v, 1.0));
      const int fu = static_cast<int>(std::lround(at.x())),
                fv = static_cast<int>(std::lround(at.y()));
      bool found = false;
      for (int dv = -1; dv <= 1; ++dv) {
        for (int du = -1; du <= 1; ++du) {
          const bool tie = std::abs(at.x() - (fu + du)) < 0.5 + 1e-9 &&
                           std::abs(at.y() - (fv + dv)) < 0.5 + 1e-9;
          if (!tie || !a->depth().contains(fu + du, fv + dv)) continue;
          const int raw = a->depth().at(fu + du, fv + dv);
          found = found || raw == b->depth().at(u, v);
        }
      }
      ASSERT_TRUE(found) << u << " " << v;
    }
  }
}

}  // namespace
