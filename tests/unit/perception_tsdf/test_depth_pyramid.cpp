// The readied depth image against plain loops.
#include <gtest/gtest.h>

#include "perception/tsdf/image/depth_pyramid.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

DepthRule rule_for(const Intrinsics& k) {
  return {0.2F,
          4.0F,
          0.04F,
          0.02F,
          static_cast<float>(k.fx),
          static_cast<float>(k.fy),
          static_cast<float>(k.cx),
          static_cast<float>(k.cy),
          1.0F,
          false};
}

int reading(const Image<std::uint16_t>& d, int u, int v) {
  if (u < 0 || v < 0 || u >= d.width() || v >= d.height()) return 0;
  const int mm = d.at(u, v);
  return mm < 200 || mm == 65535 ? 0 : mm;
}

// Depth and weight of one pixel, from the header's words.
std::uint32_t expected_low(const Image<std::uint16_t>& d, int u, int v) {
  const int c = reading(d, u, v);
  int least = 65536, readings = 0;
  for (int dv = -1; dv <= 1; ++dv)
    for (int du = -1; du <= 1; ++du)
      if (const int n = reading(d, u + du, v + dv); n != 0) least = std::min(least, n), ++readings;
  if (c == 0) return readings >= 6 ? static_cast<std::uint32_t>(least) : 0U;
  bool edge = false;
  for (const auto& [du, dv] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
    const int n = reading(d, u + du, v + dv);
    edge |= n != 0 && std::abs(n - c) > 40 + std::floor(0.02 * c + 1e-3);
  }
  if (edge) return static_cast<std::uint32_t>(least);
  return static_cast<std::uint32_t>(c) | (c <= 4000 ? 128U << 16U : 0U);
}

TEST(DepthPyramid, PixelsFollowTheRules) {
  rt::Startup startup;
  DepthPyramid pyramid(startup.token());
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    rt::Random random(seed);
    Intrinsics k{90, 91, 33.2, 20.9, 67, 43};
    Image<std::uint16_t> d(k.width, k.height);
    for (int i = 0; i < k.width * k.height; ++i) {
      const double kind = random.uniform();
      d.data()[i] = static_cast<std::uint16_t>(kind < 0.15   ? 0
                                               : kind < 0.18 ? 65535
                                               : kind < 0.22 ? 150
                                               : kind < 0.30 ? random.integer(200, 9000)
                                                             : 1500 + random.integer(-20, 20));
    }
    int weighted = 0;
    const int count = pyramid.build(d.view(), rule_for(k));
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) {
        const std::uint32_t p = pyramid.pixels()[v * k.width + u];
        const std::uint32_t want = expected_low(d, u, v);
        // One millimetre of the gate is rounding.
        if ((p & 0xffffffU) != want) {
          bool near_gate = false;
          for (const auto& [du, dv] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
            const int c = reading(d, u, v), n = reading(d, u + du, v + dv);
            near_gate |= std::abs(std::abs(n - c) - 40 - 0.02 * c) < 1.5;
          }
          EXPECT_TRUE(near_gate) << u << " " << v << ": " << std::hex << p << " want " << want;
        }
        weighted += ((p >> 16U) & 0xffU) != 0;
        if (p != 0) {
          EXPECT_GE(p >> 24U, 32U);
          EXPECT_LE(p >> 24U, 96U);
        }
      }
    EXPECT_EQ(count, weighted);
    EXPECT_GT(count, 500);
    EXPECT_EQ(pyramid.pixels()[k.width * k.height], 0U);
  }
}

TEST(DepthPyramid, RangeHoldsEveryPixelOfTheRectangle) {
  rt::Startup startup;
  DepthPyramid pyramid(startup.token());
  rt::Random random(4);
  Intrinsics k{300, 300, 150, 100, 301, 203};  // odd sizes: tiles at the border are cut
  Image<std::uint16_t> d(k.width, k.height);
  for (int i = 0; i < k.width * k.height; ++i)
    d.data()[i] =
        static_cast<std::uint16_t>(random.uniform() < 0.002 ? 0 : random.integer(1000, 1030));
  pyramid.build(d.view(), rule_for(k));
  std::int64_t loose = 0;
  for (int n = 0; n < 3000; ++n) {
    int u0 = static_cast<int>(random.integer(0, k.width - 1)),
        u1 = static_cast<int>(random.integer(0, k.width - 1));
    int v0 = static_cast<int>(random.integer(0, k.height - 1)),
        v1 = static_cast<int>(random.integer(0, k.height - 1));
    if (n % 3 != 0)
      u1 = std::min(u0 + static_cast<int>(random.integer(0, 9)), k.width - 1),
      v1 = std::min(v0 + 4, k.height - 1);
    if (u1 < u0) std::swap(u0, u1);
    if (v1 < v0) std::swap(v0, v1);
    std::uint32_t least = 65535, greatest = 0;
    for (int v = v0; v <= v1; ++v)
      for (int u = u0; u <= u1; ++u) {
        const std::uint32_t mm = pyramid.pixels()[v * k.width + u] & 0xffffU;
        least = std::min(least, mm), greatest = std::max(greatest, mm);
      }
    const auto r = pyramid.range(u0, v0, u1, v1);
    EXPECT_LE(r.least_mm, least);
    EXPECT_GE(r.greatest_mm, greatest);
    if (u1 - u0 < 3 && v1 - v0 < 3) {  // small rectangles are answered exactly
      EXPECT_EQ(r.least_mm, least);
      EXPECT_EQ(r.greatest_mm, greatest);
      ++loose;
    }
  }
  EXPECT_GE(loose, 0);
}

TEST(DepthPyramid, ReachIsOneOverCosine) {
  rt::Startup startup;
  DepthPyramid pyramid(startup.token());
  const Intrinsics k = small_camera();
  for (const double tilt : {0.0, 0.5, 0.9, 1.1}) {
    Scene scene;
    scene.planes = {{{0, 0, 2}, Vec3(std::sin(tilt), 0, -std::cos(tilt))}};
    const Frame f = render(scene, k, Pose::Identity());
    DepthRule rule = rule_for(k);
    rule.edge_base_m = 0.2F;
    pyramid.build(f.depth.view(), rule);
    int checked = 0;
    for (int v = 4; v < k.height - 4; ++v)
      for (int u = 4; u < k.width - 4; ++u) {
        const std::uint32_t p = pyramid.pixels()[v * k.width + u];
        if (((p >> 16U) & 0xffU) == 0) continue;
        const Vec3 ray = k.unproject(u, v, 1).normalized();
        const double want = std::clamp(1.0 / std::fabs(ray.dot(scene.planes[0].normal)), 1.0, 3.0);
        // Central differences of millimetres on a plane that curves in depth: a few per cent.
        EXPECT_NEAR((p >> 24U) / 32.0, want, 0.05 + 0.08 * want) << tilt << " at " << u << " " << v;
        ++checked;
      }
    EXPECT_GT(checked, 2000);
  }
}

TEST(DepthPyramid, RangeWeightFallsWithTheSquare) {
  rt::Startup startup;
  DepthPyramid pyramid(startup.token());
  Intrinsics k{90, 90, 10, 10, 21, 21};
  DepthRule rule = rule_for(k);
  rule.range_weight = true;
  for (const auto& [mm, want] :
       {std::pair{800, 128}, {1500, 128}, {2000, 72}, {3000, 32}, {3900, 32}}) {
    Image<std::uint16_t> d(21, 21, static_cast<std::uint16_t>(mm));
    pyramid.build(d.view(), rule);
    EXPECT_EQ((pyramid.pixels()[10 * 21 + 10] >> 16U) & 0xffU, static_cast<unsigned>(want)) << mm;
  }
}

}  // namespace
}  // namespace tests
