// The vector kernels against one pixel after the other, bit for bit, on every instruction set; the reduced
// frame against its definition.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "perception/segmentation/lab.hpp"
#include "perception/segmentation/lab_kernel.hpp"
#include "perception/segmentation/reduced_frame.hpp"
#include "perception/segmentation/superpixel_kernel.hpp"
#include "perception/simd/isa.hpp"
#include "rt/random.hpp"

namespace {

using namespace perception;

struct EachIsa {
  const simd::Isa before = simd::chosen();
  ~EachIsa() { simd::choose(before); }
};

std::vector<float> random_plane(rt::Random& random, std::size_t n, double low, double high) {
  std::vector<float> p(n);
  for (float& x : p) x = static_cast<float>(random.uniform(low, high));
  return p;
}

TEST(SuperpixelKernel, SameBytesAsOnePixelAfterTheOther) {
  const EachIsa restore;
  rt::Random random(3);
  for (int round = 0; round < 60; ++round) {
    const int w = static_cast<int>(random.integer(1, 60)),
              h = static_cast<int>(random.integer(1, 30));
    const auto n = static_cast<std::size_t>(w * h);
    std::array<std::vector<float>, 4> planes;
    for (auto& p : planes) p = random_plane(random, n, -60, 60);
    // Seeds in a row: ties and what was there before count.
    struct State {
      std::vector<float> best;
      std::vector<std::int32_t> nearest;
    };
    const auto run = [&](auto&& kernel, std::uint64_t seed) {
      State s{std::vector<float>(n, std::numeric_limits<float>::max()),
              std::vector<std::int32_t>(n, -1)};
      rt::Random draw(seed);
      for (int id = 0; id < 8; ++id) {
        SeedWindow window{};
        for (int k = 0; k < 4; ++k) window.planes[k] = planes[static_cast<std::size_t>(k)].data();
        window.plane_count = round % 2 == 0 ? 3 : 4;
        window.stride = w;
        window.u0 = static_cast<int>(draw.integer(0, w - 1));
        window.u1 = static_cast<int>(draw.integer(window.u0, w));
        window.v0 = static_cast<int>(draw.integer(0, h - 1));
        window.v1 = static_cast<int>(draw.integer(window.v0, h));
        for (float& x : window.plane) x = static_cast<float>(draw.uniform(-60, 60));
        window.u = static_cast<float>(draw.uniform(0, w));
        window.v = static_cast<float>(draw.uniform(0, h));
        window.beta = 1.6F;
        window.id = id;
        window.best = s.best.data(), window.nearest = s.nearest.data();
        kernel(window);
      }
      return s;
    };
    const auto seed = static_cast<std::uint64_t>(round);
    const State reference = run(try_seed_scalar, seed);
    for (const simd::Isa isa : simd::available()) {
      ASSERT_TRUE(simd::choose(isa));
      const State s = run(try_seed, seed);
      EXPECT_EQ(std::memcmp(s.best.data(), reference.best.data(), n * sizeof(float)), 0)
          << simd::name_of(isa) << " round " << round;
      EXPECT_EQ(s.nearest, reference.nearest) << simd::name_of(isa) << " round " << round;
    }
  }
}

TEST(LabKernel, SameBytesAsOnePixelAfterTheOther) {
  const EachIsa restore;
  rt::Random random(5);
  std::vector<float> curve(kLabCurveSteps + 2);
  for (std::size_t i = 0; i < curve.size(); ++i)
    curve[i] = static_cast<float>(std::cbrt(static_cast<double>(i) / kLabCurveSteps));
  for (const int count : {1, 3, 4, 7, 8, 15, 16, 17, 31, 64}) {
    const auto n = static_cast<std::size_t>(count);
    const auto r = random_plane(random, n, 0, 1), g = random_plane(random, n, 0, 1);
    auto b = random_plane(random, n, 0, 1);
    b[0] = 1, b[n - 1] = 0;
    const auto run = [&](auto&& kernel) {
      std::array<std::vector<float>, 3> out;
      for (auto& p : out) p.resize(n);
      kernel(curve.data(), LabRow{r.data(), g.data(), b.data(), out[0].data(), out[1].data(),
                                  out[2].data(), count});
      return out;
    };
    const auto reference = run(convert_light_scalar);
    for (const simd::Isa isa : simd::available()) {
      ASSERT_TRUE(simd::choose(isa));
      const auto out = run(convert_light);
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_EQ(std::memcmp(out[k].data(), reference[k].data(), n * sizeof(float)), 0)
            << simd::name_of(isa) << " " << count << " plane " << k;
    }
  }
}

TEST(ReducedFrame, MeanColourLowerMedianAndTheSameRays) {
  rt::Random random(7);
  const int w = 51, h = 38;
  const Intrinsics k{300, 310, 25.3, 18.7, w, h};
  Image<Rgb> rgb(w, h);
  Image<std::uint16_t> depth(w, h);
  for (int i = 0; i < w * h; ++i) {
    const auto byte = [&] { return static_cast<std::uint8_t>(random.integer(0, 255)); };
    rgb.data()[i] = {byte(), byte(), byte()};
    const bool none = random.uniform() < 0.3;
    depth.data()[i] =
        static_cast<std::uint16_t>(none ? 65535 * random.integer(0, 1) : random.integer(1, 4000));
  }
  ReducedFrame reduced(w, h);
  for (const int s : {2, 4}) {
    reduced.set(rgb.view(), depth.view(), k, s, -5, -5, 1000, 1000);
    const Intrinsics& q = reduced.intrinsics();
    ASSERT_EQ(q.width, w / s);
    ASSERT_EQ(q.height, h / s);
    ASSERT_EQ(reduced.colour().width, w / s);
    for (int v = 0; v < q.height; ++v)
      for (int u = 0; u < q.width; ++u) {
        double sum = 0;
        for (int y = 0; y < s; ++y)
          for (int x = 0; x < s; ++x) sum += rgb.at(s * u + x, s * v + y).g;
        EXPECT_NEAR(reduced.colour().at(u, v).g, sum / (s * s), 0.51);
        std::vector<std::uint16_t> readings;
        for (int y = s / 2 - 1; y <= s / 2; ++y)
          for (int x = s / 2 - 1; x <= s / 2; ++x) {
            const std::uint16_t d = depth.at(s * u + x, s * v + y);
            if (d != 0 && d != 65535) readings.push_back(d);
          }
        std::sort(readings.begin(), readings.end());
        EXPECT_EQ(reduced.depth().at(u, v),
                  readings.empty() ? 0 : readings[(readings.size() - 1) / 2]);
        // The middle of what it covers lies on its ray.
        const Vec3 full = k.unproject(s * u + 0.5 * (s - 1), s * v + 0.5 * (s - 1), 1.0);
        EXPECT_LT((q.unproject(u, v, 1.0) - full).norm(), 1e-12);
      }
  }
}

}  // namespace
