// Somebody who is put into another camera's images: nobody before, in true order of depth, large
// enough, walking.
#include "drivers/camera/passing_camera.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "drivers/camera/synthetic_camera.hpp"
#include "tests/unit/drivers_camera/scene.hpp"

namespace {

using camera_test::startup;
using perception::RgbdFrame;

constexpr std::uint16_t kWall_mm = 3000;
constexpr perception::Rgb kWallColour{1, 2, 3};
constexpr rt::Time kFrom{rt::Nanos{2'000'000'000}};

// A wall across the view; its upper rows have no reading.
class Wall final : public drivers::Camera {
 public:
  explicit Wall(std::uint16_t depth_mm) : depth_mm_(depth_mm) {}
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return {182.5, 182.5, 127.5, 105.5, 256, 212};
  }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time now, RgbdFrame& out) noexcept override {
    out.intrinsics = intrinsics();
    out.exposure = now;
    out.seq = seq_++;
    out.has_colour = true;
    std::fill(out.depth_mm.begin(), out.depth_mm.end(), depth_mm_);
    std::fill_n(out.depth_mm.begin(), kBlank, std::uint16_t{0});
    std::fill(out.colour.begin(), out.colour.end(), kWallColour);
    return drivers::CameraStatus::kFrame;
  }
  static constexpr int kBlank = 40 * 256, kPixels = 256 * 212;

 private:
  std::uint16_t depth_mm_;
  std::uint64_t seq_ = 0;
};

class Passing : public testing::Test {
 protected:
  explicit Passing(std::uint16_t wall_mm = kWall_mm)
      : camera_(startup.token(), std::make_unique<Wall>(wall_mm),
                drivers::SyntheticCameraConfig{}.X_BC(), kFrom) {}
  const RgbdFrame& at(int frame) {
    EXPECT_EQ(camera_.poll(kFrom + rt::nanos_from_seconds(frame / 30.0), *image_),
              drivers::CameraStatus::kFrame);
    return *image_;
  }
  struct Seen {
    int before_wall = 0, dropped = 0, where_blank = 0, behind = 0;
    double column = 0, depth_m = 0;  // means
  };
  Seen seen(int frame, std::uint16_t wall_mm = kWall_mm) {
    const RgbdFrame& f = at(frame);
    Seen s;
    for (int i = 0; i < Wall::kPixels; ++i) {
      const auto n = static_cast<std::size_t>(i);
      const bool blank = i < Wall::kBlank;
      const bool theirs = f.colour[n].r != kWallColour.r;
      if (f.depth_mm[n] == (blank ? 0 : wall_mm)) continue;
      EXPECT_TRUE(theirs) << i;
      if (f.depth_mm[n] == 0) {
        ++s.dropped;
        continue;
      }
      s.where_blank += blank ? 1 : 0;
      s.behind += !blank && f.depth_mm[n] > wall_mm ? 1 : 0;
      ++s.before_wall;
      s.column += i % 256;
      s.depth_m += 1e-3 * f.depth_mm[n];
    }
    s.column /= std::max(1, s.before_wall);
    s.depth_m /= std::max(1, s.before_wall);
    return s;
  }
  drivers::PassingCamera camera_;
  std::unique_ptr<RgbdFrame> image_ = std::make_unique<RgbdFrame>();
};

TEST_F(Passing, NobodyBeforeThatInstant) {
  const RgbdFrame& f = at(-1);
  for (int i = 0; i < Wall::kPixels; ++i) {
    ASSERT_EQ(f.depth_mm[static_cast<std::size_t>(i)], i < Wall::kBlank ? 0 : kWall_mm) << i;
    ASSERT_EQ(f.colour[static_cast<std::size_t>(i)].g, kWallColour.g) << i;
  }
}

TEST_F(Passing, ASixthToNearlyHalfOfTheImageAtWalkingPace) {
  double most = 0;
  int with = 0, compared = 0;
  Seen last;
  for (int frame = 0; frame < 126; ++frame) {  // a round
    const Seen s = seen(frame);
    const double share = (s.before_wall + s.dropped) / double{Wall::kPixels};
    most = std::max(most, share);
    with += share > 0.02 ? 1 : 0;
    EXPECT_EQ(s.behind, 0) << frame;
    // In the middle of the view nothing of them is cut off: 50 mm an image.
    if (std::abs(s.column - 127.5) < 40 && std::abs(last.column - 127.5) < 40 && s.depth_m > 0.5) {
      const double step_m = std::abs(s.column - last.column) / 182.5 * s.depth_m;
      EXPECT_NEAR(step_m, 0.05, 0.02) << frame;
      ++compared;
    }
    last = s;
  }
  EXPECT_GT(most, 0.15);
  EXPECT_LT(most, 0.45);
  EXPECT_GT(with, 63);
  EXPECT_GT(compared, 20);
}

TEST_F(Passing, TheirOutlineDropsOutAndTheyFillWhatHadNoReading) {
  const Seen s = seen(26);
  EXPECT_GT(s.dropped, 20);
  EXPECT_GT(s.where_blank, 100);
}

class BehindAWall : public Passing {
 protected:
  BehindAWall() : Passing(500) {}
};

TEST_F(BehindAWall, NobodyIsSeenThroughWhatIsNearer) {
  for (int frame = 0; frame < 126; frame += 9) {
    const Seen s = seen(frame, 500);
    EXPECT_EQ(s.before_wall, s.where_blank) << frame;
    EXPECT_EQ(s.dropped, 0) << frame;
  }
}

TEST(PassingAgain, TheSameBytes) {
  std::array<std::unique_ptr<RgbdFrame>, 2> f;
  for (auto& image : f) {
    image = std::make_unique<RgbdFrame>();
    drivers::PassingCamera camera(startup.token(), std::make_unique<Wall>(kWall_mm),
                                  drivers::SyntheticCameraConfig{}.X_BC(), kFrom);
    (void)camera.poll(kFrom + rt::nanos_from_seconds(0.9), *image);
  }
  EXPECT_EQ(f[0]->depth_mm, f[1]->depth_mm);
}

}  // namespace
