// A map that learns in time: what goes is forgotten, what moves is followed, what stands is left alone.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

constexpr double kVoxel = 0.01, kSigma_m = 0.0012;

// A wall, and a plate before it whose face is at x = face; none: it is not there.
Scene plate(std::optional<double> face) {
  Scene s;
  s.planes = {{{1.3, 0, 0}, -Vec3::UnitX()}, {{0, 0, -0.45}, Vec3::UnitZ()}};
  if (face) s.boxes = {{{*face, -0.15, -0.15}, {*face + 0.1, 0.15, 0.15}}};
  return s;
}

Pose eye() { return look_at(Vec3(0.003, 0.002, 0.001), Vec3(1.3, 0.05, 0.03)); }

struct Watched {
  explicit Watched(bool follow, std::uint64_t seed_ = 3) : seed(seed_), map(startup.token(), [&] {
    TsdfConfig c = small_map(kVoxel);
    c.follow_changes = follow;
    return c;
  }()) {}
  IntegrateStats see(const Scene& scene, const Pose& X_at = eye(), const Pose& X_said = eye()) {
    const Frame f = render(scene, small_camera(), X_at, kSigma_m, 0, rt::Random(seed, ++frame));
    const IntegrateStats out = map.integrate(f.view(), X_said, 1);
    EXPECT_FALSE(out.refused);
    moved += out.blocks_moved;
    return out;
  }
  void see(const Scene& scene, int frames) {
    for (int n = 0; n < frames; ++n) see(scene);
  }
  // Mean x of the zero crossings over the plate's middle, within 60 mm of `near`; NaN: there is none.
  [[nodiscard]] double face(double near) const {
    double sum = 0;
    int count = 0;
    for (int j = -8; j <= 8; ++j)
      for (int l = -8; l <= 8; ++l)
        for (int i = static_cast<int>((near - 0.06) / kVoxel); i < (near + 0.06) / kVoxel; ++i) {
          const std::uint32_t a = map.word_at(i, j, l), b = map.word_at(i + 1, j, l);
          const double da = TsdfMap::word_distance(a), db = TsdfMap::word_distance(b);
          if (TsdfMap::word_weight(a) < 256 || TsdfMap::word_weight(b) < 256 || da <= 0 || db > 0)
            continue;
          sum += kVoxel * (i + da / (da - db));
          ++count;
          break;
        }
    return count > 200 ? sum / count : std::nan("");
  }
  // Observed voxels inside the plate's place, 10 mm off its sides, that are not outside of anything.
  [[nodiscard]] int solid(double face_x) const {
    int out = 0;
    for (int i = static_cast<int>(face_x / kVoxel) - 2; i < (face_x + 0.06) / kVoxel; ++i)
      for (int j = -14; j <= 14; ++j)
        for (int l = -14; l <= 14; ++l) {
          const std::uint32_t w = map.word_at(i, j, l);
          out += TsdfMap::word_weight(w) >= 256 && TsdfMap::word_distance(w) <= 0 ? 1 : 0;
        }
    return out;
  }

  std::uint64_t seed, frame = 0;
  rt::Startup startup;
  TsdfMap map;
  int moved = 0;
};

TEST(Changes, WhatIsSeenThroughIsForgottenIn8FramesHoweverLongItStood) {
  for (const int stood : {5, 120}) {
    Watched w(true);
    w.see(plate(1.0), stood);
    ASSERT_GT(w.solid(1.0), 1000);
    int frames = 0;
    while (w.solid(1.0) > 0 && frames < 40) w.see(plate({})), ++frames;
    std::printf("stood %d frames: gone after %d\n", stood, frames);
    EXPECT_LE(frames, 8) << "(20 / 22)^8 < 1/2";
    EXPECT_GE(frames, 2);
  }
}

TEST(Changes, AMovingSurfaceIsFollowedWithin3FramesAnd1500um) {
  for (const double mm : {0.1, 0.5, 1.0, 2.0, 3.3, -0.5, -3.3}) {
    const auto seed = static_cast<std::uint64_t>(100 + 10 * mm);
    double lag_mm[2] = {};
    for (const bool follow : {false, true}) {
      Watched w(follow, seed);
      w.see(plate(1.0), 40);
      double x = 1.0;
      const int frames = std::abs(mm) < 0.3 ? 60 : 20;
      for (int n = 0; n < frames; ++n) {
        x -= 1e-3 * mm;
        w.see(plate(x));
        const double lag = std::abs(w.face(x) - x) * 1e3;
        if (!(lag <= lag_mm[follow ? 1 : 0])) lag_mm[follow ? 1 : 0] = lag;
      }
      if (!follow) continue;
      EXPECT_LE(lag_mm[1], 3 * std::abs(mm) + 1.5) << mm << " mm a frame, seed " << seed;
      // At rest again: within a millimetre after 10 frames.
      w.see(plate(x), 10);
      EXPECT_NEAR(w.face(x), x, 1e-3) << mm;
    }
    std::printf("%+.1f mm a frame: lag at most %.2f mm, %.2f if blocks are not moved (seed %d)\n",
                mm, lag_mm[1], lag_mm[0], static_cast<int>(seed));
    if (std::abs(mm) >= 1) {
      EXPECT_GT(lag_mm[0], 3 * std::abs(mm) + 1.5);
    }
  }
}

TEST(Changes, NoiseAloneMovesNothing) {
  for (const std::uint64_t seed : {5U, 6U}) {
    Watched w(true, seed), plain(false, seed);
    w.see(plate(1.0), 60);
    plain.see(plate(1.0), 60);
    EXPECT_EQ(w.moved, 0) << "seed " << seed;
    EXPECT_EQ(w.map.checksum(), plain.map.checksum());
  }
}

TEST(Changes, AWrongPoseIsNotLearnedAndWhatMovesMeanwhileIs) {
  rt::Random random(8);
  for (int n = 0; n < 6; ++n) {
    Pose off = Pose::Identity();
    const auto part = [&](double most) { return random.uniform(-most, most); };
    off.translation() = Vec3(part(5e-3), part(5e-3), part(5e-3));
    off.linear() =
        Eigen::AngleAxisd(part(4e-3), Vec3(part(1), part(1), part(1)).normalized()).toRotationMatrix();
    Watched w(true, 20 + static_cast<std::uint64_t>(n));
    w.see(plate(1.0), 30);
    w.moved = 0;
    for (int k = 0; k < 3; ++k) w.see(plate(1.0), eye(), eye() * off);
    EXPECT_LE(w.moved, 3) << "draw " << n << " of seed 8";
    const double before = w.face(1.0);
    w.moved = 0;
    for (int k = 0; k < 2; ++k) w.see(plate(0.99), eye(), eye() * off);
    EXPECT_GE(w.moved, 6) << n;
    // By its own way, not by the camera's.
    EXPECT_NEAR(before - w.face(0.99), 0.01, 2.5e-3) << n;
  }
}

TEST(Changes, AViewThatMovesAsAWholeIsNotLearned) {
  Watched w(true);
  w.see(plate(1.0), 30);
  Scene all = plate(0.99);
  for (auto& p : all.planes) p.point -= Vec3(0.01, 0, 0);
  w.see(all, 4);
  EXPECT_LE(w.moved, 2);
}

TEST(Changes, WhatComesToRestInSeenFreeSpaceIsThereWithin20Frames) {
  Watched w(true);
  w.see(plate(1.0), 60);  // leaves known voxels when it goes
  w.see(plate({}), 30);
  ASSERT_EQ(w.solid(1.0), 0);
  w.see(plate(1.01), 20);
  EXPECT_NEAR(w.face(1.01), 1.01, 3e-3);
}

// Pixels without a reading where the wall is left of the plate's middle: as behind glass, or out of range.
void blind(Frame& f, double until_u) {
  for (int v = 0; v < f.k.height; ++v)
    for (int u = 0; u < until_u; ++u) f.depth.at(u, v) = 0;
}

TEST(Changes, WhereMuchIsSeenToGoWhatHasNoReadingBehindItFades) {
  Watched w(true);
  w.see(plate(1.0), 60);
  // The border of what is read runs through a block: to its right the plate is seen to be gone.
  const Vec3 edge_C = eye().inverse() * Vec3(1.0, 0.035, 0.0);
  const double u = 91.25 * edge_C.x() / edge_C.z() + 63.5;
  const auto known = [&](int j) {
    int out = 0;
    for (int l = -8; l < 8; ++l)
      for (int i = 98; i < 104; ++i) {
        const std::uint32_t word = w.map.word_at(i, j, l);
        out += TsdfMap::word_weight(word) >= 256 && TsdfMap::word_distance(word) <= 0 ? 1 : 0;
      }
    return out;
  };
  // Image x goes against world y.
  const int beside = 5, far = 12;
  ASSERT_GT(known(beside), 20);
  ASSERT_GT(known(far), 20);
  for (int n = 0; n < 10; ++n) {
    Frame f = render(plate({}), small_camera(), eye(), kSigma_m, 0, rt::Random(9, static_cast<std::uint64_t>(n)));
    blind(f, u);
    w.map.integrate(f.view(), eye(), 1);
  }
  EXPECT_EQ(known(beside), 0);
  // Two blocks on, nothing was seen to go: it stays, as a dark thing would.
  EXPECT_GT(known(far), 20);
}

TEST(Changes, WhatIsMaskedIsLeftAlone) {
  Watched w(true);
  w.see(plate(1.0), 40);
  const std::uint64_t before = w.map.checksum();
  Frame f = render(plate(0.8), small_camera(), eye());
  for (int v = 0; v < f.k.height; ++v)
    for (int u = 0; u < f.k.width; ++u) f.depth.at(u, v) = 0;
  for (int n = 0; n < 20; ++n) w.map.integrate(f.view(), eye(), 1);
  EXPECT_EQ(w.map.checksum(), before);
}

}  // namespace
}  // namespace tests
