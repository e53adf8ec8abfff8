// The vector kernels against one pixel after the other, bit for bit, on every instruction set; the
// reduced frame against its definition.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "perception/geometry/no_colour.hpp"
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
    std::vector<float> known(n);
    for (float& x : known) x = random.uniform() < 0.5 ? 1.0F : 0.0F;
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
        window.known = round % 4 < 2 ? nullptr : known.data();
        window.seed_known = draw.uniform() < 0.8 ? 1.0F : 0.0F;
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

// Where the pixel or the seed has no colour the first planes could hold anything.
TEST(SuperpixelKernel, NoColourIsNoDifference) {
  const int w = 24, h = 3;
  rt::Random random(6);
  std::array<std::vector<float>, 4> planes;
  for (auto& p : planes) p = random_plane(random, w * h, -60, 60);
  std::vector<float> known(w * h);
  for (float& x : known) x = random.uniform() < 0.5 ? 1.0F : 0.0F;
  const auto run = [&](float seed_known) {
    std::vector<float> best(w * h, std::numeric_limits<float>::max());
    std::vector<std::int32_t> nearest(w * h, -1);
    SeedWindow window{};
    for (int k = 0; k < 4; ++k) window.planes[k] = planes[static_cast<std::size_t>(k)].data();
    window.plane_count = 4, window.stride = w, window.u1 = w, window.v1 = h;
    window.u = 11, window.v = 1, window.beta = 1;
    window.plane[3] = 7;
    window.known = known.data(), window.seed_known = seed_known;
    window.best = best.data(), window.nearest = nearest.data();
    try_seed(window);
    return best;
  };
  const auto coloured = run(1), not_coloured = run(0);
  for (int i = 0; i < w * h; ++i) {
    const auto k = static_cast<std::size_t>(i);
    double c2 = 0;
    for (std::size_t p = 0; p < 3; ++p)
      c2 += static_cast<double>(planes[p][k]) * static_cast<double>(planes[p][k]);
    const double e = static_cast<double>(planes[3][k]) - 7;
    const double away = std::hypot(i % w - 11, i / w - 1);
    EXPECT_NEAR(static_cast<double>(not_coloured[k]), std::abs(e) + away, 1e-3);
    EXPECT_NEAR(static_cast<double>(coloured[k]),
                std::sqrt(known[k] != 0 ? c2 + e * e : e * e) + away, 1e-3);
  }
}

TEST(LabImage, HalfIsTheMeanOfWhatHasColour) {
  rt::Random random(8);
  const int w = 33, h = 21;
  Image<Rgb> rgb(w, h);
  LabImage whole(w, h), half(w, h);
  for (const double lacking : {0.0, 0.5, 1.0}) {
    for (int i = 0; i < w * h; ++i) {
      const auto byte = [&] { return static_cast<std::uint8_t>(random.integer(1, 255)); };
      rgb.data()[i] = random.uniform() < lacking ? kNoColour : Rgb{byte(), byte(), byte()};
    }
    whole.set(rgb.view());
    half.set_half(rgb.view());
    EXPECT_EQ(whole.known() == nullptr, lacking == 0);
    EXPECT_EQ(half.known() == nullptr, lacking == 0);
    for (int i = 0; i < w * h; ++i) {
      ASSERT_EQ(whole.coloured(i), has_colour(rgb.data()[i]));
      if (!whole.coloured(i)) continue;
      EXPECT_NEAR(whole.at(i).L, lab_of(rgb.data()[i]).L, 0.05);
    }
    for (int v = 0; v < h / 2; ++v)
      for (int u = 0; u < w / 2; ++u) {
        // The mean of the light, by way of a grey of it.
        double light = 0, n = 0;
        for (int y = 0; y < 2; ++y)
          for (int x = 0; x < 2; ++x) {
            const Rgb c = rgb.at(2 * u + x, 2 * v + y);
            if (!has_colour(c)) continue;
            const auto linear = [](int s) {
              return s <= 10 ? s / 255.0 / 12.92 : std::pow((s / 255.0 + 0.055) / 1.055, 2.4);
            };
            light += 0.2126729 * linear(c.r) + 0.7151522 * linear(c.g) + 0.072175 * linear(c.b);
            n += 1;
          }
        const int i = v * (w / 2) + u;
        ASSERT_EQ(half.coloured(i), n > 0);
        if (n == 0) continue;
        const double y = light / n;
        EXPECT_NEAR(static_cast<double>(half.at(i).L),
                    y > 0.008856 ? 116 * std::cbrt(y) - 16 : 903.3 * y, 0.1);
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
    if (random.uniform() < 0.4) rgb.data()[i] = kNoColour;
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
        double sum = 0, coloured = 0;
        for (int y = 0; y < s; ++y)
          for (int x = 0; x < s; ++x) {
            sum += rgb.at(s * u + x, s * v + y).g;
            coloured += has_colour(rgb.at(s * u + x, s * v + y)) ? 1 : 0;
          }
        EXPECT_EQ(has_colour(reduced.colour().at(u, v)), coloured > 0);
        EXPECT_NEAR(reduced.colour().at(u, v).g, sum / std::max(1.0, coloured), 0.51);
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
