// Small views against brute force, and which of them are kept.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "perception/relocalisation/keyframes.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

constexpr int kW = Thumbnail::kWidth, kH = Thumbnail::kHeight;

Thumbnail random_view(rt::Random& random, double holes) {
  Thumbnail t;
  for (std::size_t i = 0; i < t.depth.size(); ++i) {
    const bool hole = random.uniform() < holes;
    t.depth[i] = hole ? std::uint8_t{0} : static_cast<std::uint8_t>(1 + 254 * random.uniform());
    t.grey[i] = static_cast<std::uint8_t>(1 + 254 * random.uniform());
  }
  return t;
}

// As the header says it, cell by cell in floating point.
int reference_distance(const Thumbnail& a, const Thumbnail& b, int du, int dv) {
  double cost = 0;
  int common = 0, cells = 0;
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const int x = u + du, y = v + dv;
      if (x < 0 || y < 0 || x >= kW || y >= kH) continue;
      const auto i = static_cast<std::size_t>(v * kW + u), j = static_cast<std::size_t>(y * kW + x);
      const double za = a.depth[i], zb = b.depth[j], ga = a.grey[i], gb = b.grey[j];
      if (ga > 0 && gb > 0) cost += std::floor(std::min(std::fabs(ga - gb), 48.0) / 2);
      if (za <= 0 && zb <= 0) continue;
      ++cells;
      if (za > 0 && zb > 0) {
        ++common;
        cost += std::min(std::fabs(za - zb), 24.0);
      } else {
        cost += 12;
      }
    }
  }
  return common < 64 ? std::numeric_limits<int>::max()
                     : static_cast<int>(std::floor(256 * cost / cells));
}

TEST(Thumbnail, DistanceEqualsTheReference) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    rt::Random random(seed);
    const Thumbnail a = random_view(random, 0.2), b = random_view(random, seed > 6 ? 0.97 : 0.3);
    for (const int du : {-6, -1, 0, 4}) {
      for (const int dv : {-3, 0, 2}) {
        EXPECT_EQ(thumbnail_distance(a, b, du, dv), reference_distance(a, b, du, dv))
            << "seed " << seed << " shift " << du << ' ' << dv;
      }
    }
    EXPECT_EQ(thumbnail_distance(a, a, 0, 0), 0);
  }
}

TEST(Thumbnail, CodesDepthAndLeavesExposureOut) {
  const Intrinsics k{32, 32, 31.5, 25.5, 64, 52};
  DepthLevel level;
  level.intrinsics = k;
  level.depth = PaddedImage(k.width, k.height);
  level.depth.reshape(k.width, k.height);
  std::vector<Rgb> bright(static_cast<std::size_t>(k.width * k.height)), dim = bright;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      level.depth.row(v)[u] = u < 8 ? 0.0F : 0.5F + 0.05F * static_cast<float>(u);
      const auto g = static_cast<std::uint8_t>(40 + 2 * u + v);
      bright[static_cast<std::size_t>(v * k.width + u)] = {g, g, g};
      const auto d = static_cast<std::uint8_t>(g / 2 + 10);
      dim[static_cast<std::size_t>(v * k.width + u)] = {d, d, d};
    }
  }
  const Thumbnail a = make_thumbnail(level, {bright.data(), k.width, k.height, k.width});
  const Thumbnail b = make_thumbnail(level, {dim.data(), k.width, k.height, k.width});
  const Thumbnail none = make_thumbnail(level, {});
  EXPECT_EQ(a.depth[0], 0) << "no reading";
  const double z = static_cast<double>(level.depth.row(1)[41]);  // pixel of cell 20
  EXPECT_NEAR(a.depth[20], 1 + std::log(z / 0.3) / std::log(1.012), 0.51);
  EXPECT_LT(thumbnail_distance(a, b, 0, 0), 2 * 256) << "half the light, the same place";
  EXPECT_TRUE(std::all_of(none.grey.begin(), none.grey.end(), [](auto g) { return g == 0; }));
}

// What has no colour has no brightness, and makes nothing else darker.
TEST(Thumbnail, WhereThereIsNoColourThereIsNoBrightness) {
  const Intrinsics k{32, 32, 95.5, 77.5, 192, 156};
  DepthLevel level;
  level.intrinsics = k;
  level.depth = PaddedImage(k.width, k.height);
  level.depth.reshape(k.width, k.height);
  std::vector<Rgb> all(static_cast<std::size_t>(k.width * k.height));
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const auto g = static_cast<std::uint8_t>(60 + (u / 6 * 37 + v / 6 * 91) % 130);
      all[static_cast<std::size_t>(v * k.width + u)] = {g, g, g};
      level.depth.row(v)[u] = 1;
    }
  std::vector<Rgb> some = all;
  for (int v = 0; v < k.height; ++v)
    for (int u = 60; u < 90; ++u)  // cells 10 to 14
      some[static_cast<std::size_t>(v * k.width + u)] = {};
  // In cell 20, of each row of pixels all but one.
  for (int v = 0; v < k.height; ++v)
    for (int u = 120; u < 125; ++u) some[static_cast<std::size_t>(v * k.width + u)] = {};
  const Thumbnail a = make_thumbnail(level, {all.data(), k.width, k.height, k.width});
  const Thumbnail b = make_thumbnail(level, {some.data(), k.width, k.height, k.width});
  for (int v = 0; v < Thumbnail::kHeight; ++v)
    for (int u = 0; u < Thumbnail::kWidth; ++u) {
      const auto n = static_cast<std::size_t>(v * Thumbnail::kWidth + u);
      EXPECT_NE(a.grey[n], 0);
      if (u >= 10 && u < 15) {
        EXPECT_EQ(b.grey[n], 0);
      } else {
        EXPECT_NEAR(b.grey[n], a.grey[n], 6) << u << " " << v;
      }
    }
  const std::vector<Rgb> none(all.size());
  const Thumbnail dark = make_thumbnail(level, {none.data(), k.width, k.height, k.width});
  EXPECT_TRUE(std::all_of(dark.grey.begin(), dark.grey.end(), [](auto g) { return g == 0; }));
}

Pose at(double x, double yaw_deg = 0) {
  Pose X = Pose::Identity();
  X.translation().x() = x;
  X.linear() = Eigen::AngleAxisd(yaw_deg * M_PI / 180, Vec3::UnitY()).toRotationMatrix();
  return X;
}

TEST(Keyframes, KeepsNewPlacesAndStaysBounded) {
  rt::Startup startup;
  KeyframeConfig config;
  config.max_keyframes = 8;
  Keyframes keyframes(startup.token(), config);
  rt::Random random(3);
  EXPECT_TRUE(keyframes.is_new(at(0)));
  keyframes.add(at(0), random_view(random, 0));
  EXPECT_FALSE(keyframes.is_new(at(0.15, 10)));
  EXPECT_TRUE(keyframes.is_new(at(0.25)));
  EXPECT_TRUE(keyframes.is_new(at(0.0, 15)));
  std::vector<Thumbnail> views;
  for (int i = 0; i < 20; ++i) views.push_back(random_view(random, 0));
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 1; i < 20; ++i) keyframes.add(at(0.3 * i), views[static_cast<std::size_t>(i)]);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  EXPECT_EQ(keyframes.size(), 8);
  EXPECT_FALSE(keyframes.is_new(at(0.3 * 19))) << "the newest is kept";
}

TEST(Keyframes, FindsTheShiftedViewBestFirstAndPassesOverTheRest) {
  rt::Startup startup;
  Keyframes keyframes(startup.token(), {});
  rt::Random random(5);
  for (int i = 0; i < 40; ++i) keyframes.add(at(0.3 * i), random_view(random, 0.1));
  // What keyframe 17 shows, two cells further to the left.
  Thumbnail seen = random_view(random, 0);
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u + 2 < kW; ++u) {
      const auto to = static_cast<std::size_t>(v * kW + u), from = to + 2;
      seen.depth[to] = keyframes.at(17).view.depth[from];
      seen.grey[to] = keyframes.at(17).view.grey[from];
    }
  }
  EXPECT_EQ(thumbnail_distance(seen, keyframes.at(17).view, 2, 0), 0);
  std::array<Keyframes::Candidate, 3> found;
  std::array<bool, Keyframes::kMax> skip{};
  // Random views say nothing without the shift, so the short list is narrowed to those near 17.
  for (std::size_t i = 0; i < 40; ++i) skip[i] = i < 12 || i > 22;
  ASSERT_EQ(keyframes.rank(seen, skip, found), 3);
  EXPECT_EQ(found[0].index, 17);
  EXPECT_EQ(found[0].du, 2);
  EXPECT_EQ(found[0].dv, 0);
  EXPECT_LE(found[0].distance, found[1].distance);
  EXPECT_LE(found[1].distance, found[2].distance);
  skip[17] = true;
  ASSERT_EQ(keyframes.rank(seen, skip, found), 3);
  EXPECT_NE(found[0].index, 17);
}

}  // namespace
}  // namespace perception
