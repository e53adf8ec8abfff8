// What the depth stream makes of a camera's noise: at rest, at edges, in motion, and at what size.
#include <cmath>

#include "tests/unit/drivers_depth_stream/streams.hpp"

namespace {

using namespace depth_stream_test;
using test_support::DepthScene;
using test_support::DepthSceneNoise;

constexpr int kWidth = 256, kHeight = 212;

// Squared errors against the truth in sigma, of readings that are of the surface.
struct Errors {
  double shown = 0, read = 0;
  long pixels = 0;
  void add(const DepthScene& scene, const Image& read_mm, const Image& shown_mm) {
    for (std::size_t i = 0; i < read_mm.size(); ++i) {
      const double z = scene.truth_m()[i] * 1000, sigma = DepthScene::sigma_m(z / 1000) * 1000;
      if (read_mm[i] == 0 || scene.edge(i)) continue;
      shown += std::pow((shown_mm[i] - z) / sigma, 2);
      read += std::pow((read_mm[i] - z) / sigma, 2);
      ++pixels;
    }
  }
  [[nodiscard]] double ratio() const { return std::sqrt(shown / read); }
};

TEST(DepthQuality, AtRestTheMeanOverTheFramesIsThatOfTheReadings) {
  constexpr int kFrames = 60;
  DepthScene scene(kWidth, kHeight);
  scene.look(0.4);
  Streams s(kWidth, kHeight);
  std::vector<double> shown(s.shown.size()), read(s.shown.size());
  std::vector<int> count(s.shown.size());
  Errors errors;
  std::size_t bytes = 0, late = 0;
  for (std::uint64_t f = 0; f < kFrames; ++f) {
    const Image image = scene.image({}, 11, f);
    ASSERT_TRUE(s.pass(image, {DepthMode::kQuiet, -1, false}));
    errors.add(scene, image, s.shown);
    bytes += s.info.bytes;
    if (f >= kFrames - 10) late += s.info.bytes;
    for (std::size_t i = 0; i < image.size(); ++i) {
      if (image[i] == 0) continue;
      shown[i] += s.shown[i];
      read[i] += image[i];
      ++count[i];
    }
  }
  double of_shown = 0, of_read = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    if (count[i] < kFrames || scene.edge(i)) continue;
    of_shown += std::pow(shown[i] / count[i] - scene.truth_m()[i] * 1000, 2);
    of_read += std::pow(read[i] / count[i] - scene.truth_m()[i] * 1000, 2);
  }
  const double mean_ratio = std::sqrt(of_shown / of_read);
  const double bits =
      8.0 * static_cast<double>(bytes) / kFrames / static_cast<double>(count.size());
  const double late_bits = 8.0 * static_cast<double>(late) / 10 / static_cast<double>(count.size());
  std::printf(
      "  error over sensor %.2f; mean of %d frames: %.2f of the readings' mean; %.2f bit a "
      "pixel, the last ten frames %.2f\n",
      errors.ratio(), kFrames, mean_ratio, bits, late_bits);
  EXPECT_LT(errors.ratio(), 0.9);
  // A running mean alone makes sqrt(2) of it: it shows the first frames' noise again and again.
  EXPECT_LT(mean_ratio, 1.3);
  EXPECT_LT(bits, 0.75);
}

// A pixel that sees one surface, then the other: what is shown lies on one of them.
TEST(DepthQuality, NoPixelFliesBetweenTwoSurfaces) {
  rt::Random random(31);
  Streams s(64, 64);
  const std::size_t n = s.shown.size();
  for (const DepthMode mode : {DepthMode::kFaithful, DepthMode::kQuiet, DepthMode::kMoving}) {
    for (int frame = 0; frame < 60; ++frame) {
      Image image(n);
      for (std::size_t i = 0; i < n; ++i) {
        const bool far = i % 64 > 32 || (i % 64 >= 30 && random.uniform() < 0.5);
        const double z = far ? 1500 : 1200;
        image[i] = static_cast<std::uint16_t>(z + 1.3 * random.normal());
      }
      ASSERT_TRUE(s.pass(image, {mode, -1, false}));
      for (std::size_t i = 0; i < n; ++i)
        ASSERT_LT(std::abs(s.shown[i] - image[i]), 30) << "seed 31, pixel " << i;
    }
  }
}

// What has moved is shown where it is, at once.
TEST(DepthQuality, AStepIsShownInItsFrame) {
  Streams s(32, 32);
  for (const DepthMode mode : {DepthMode::kFaithful, DepthMode::kQuiet}) {
    for (int frame = 0; frame < 40; ++frame)
      ASSERT_TRUE(s.pass(Image(1024, 1000), {mode, -1, false}));
    ASSERT_TRUE(s.pass(Image(1024, 1040), {mode, -1, false}));
    for (const std::uint16_t v : s.shown) ASSERT_NEAR(v, 1040, 2);
  }
}

TEST(DepthQuality, MovingStrictFitsTheRoad) {
  for (const double lateral_px : {0.0, 0.3}) {
    DepthScene scene(512, 424);
    Streams s(512, 424);
    Errors errors;
    std::size_t bytes = 0;
    constexpr int kFrames = 4;
    for (std::uint64_t f = 0; f < kFrames; ++f) {
      scene.look(0.033 * static_cast<double>(f) + 1);
      const Image image = scene.image({1, lateral_px, 0.3}, 5, f);
      ASSERT_TRUE(s.pass(image, {DepthMode::kMoving, -1, false}));
      errors.add(scene, image, s.shown);
      bytes += s.info.bytes;
    }
    const double mbit_s = 8e-6 * 24 * static_cast<double>(bytes) / kFrames;
    std::printf("  lateral %.1f px: %.2f Mbit/s at 24 frames a second, error over sensor %.2f\n",
                lateral_px, mbit_s, errors.ratio());
    EXPECT_LT(mbit_s, 7.5);
    EXPECT_LT(errors.ratio(), 1.15);
  }
}

}  // namespace
