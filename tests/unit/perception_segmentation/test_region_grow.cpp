// Method `paper` against its definition, kept step by step on small images.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "perception/geometry/no_colour.hpp"
#include "perception/segmentation/region_grow.hpp"
#include "rt/random.hpp"

namespace {

using namespace perception;

struct Scene {
  Image<Rgb> rgb;
  Image<std::uint16_t> depth;
  Intrinsics k;
};

// `lacking`: share of the pixels without colour.
Scene random_scene(rt::Random& random, int w, int h, double lacking) {
  Scene s{Image<Rgb>(w, h), Image<std::uint16_t>(w, h), {50, 50, w / 2.0, h / 2.0, w, h}};
  const auto level = [&](int at, int spread) {
    return static_cast<std::uint8_t>(at + random.integer(-spread, spread));
  };
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const bool right = u > w / 2;
      s.rgb.at(u, v) = {level(right ? 160 : 90, 12), level(100, 12), level(right ? 60 : 120, 12)};
      if (lacking > 0 && random.uniform() < lacking) s.rgb.at(u, v) = kNoColour;
      const bool hole = random.uniform() < 0.1;
      s.depth.at(u, v) =
          static_cast<std::uint16_t>(hole ? 0 : 800 + (right ? 40 : 0) + random.integer(-3, 3));
    }
  }
  return s;
}

// d of a pixel to the means of `members`, from the formula.
struct Slow {
  const Image<Rgb>& rgb;
  const LabImage& lab;
  const PointImage* points;
  const GrowConfig& c;
  int seed, seed_place;

  void place(int i, double p[3]) const {
    if (points == nullptr) {
      p[0] = i % lab.width(), p[1] = i / lab.width(), p[2] = 0;
      return;
    }
    const int k = i == seed ? seed_place : i;
    p[0] = static_cast<double>(points->x_mm()[k]);
    p[1] = static_cast<double>(points->y_mm()[k]);
    p[2] = static_cast<double>(points->z_mm()[k]);
  }
  double distance(int i, const std::set<int>& members) const {
    double m[6] = {0, 0, 0, 0, 0, 0}, p[3], coloured = 0;
    for (const int j : members) coloured += has_colour(rgb.data()[j]) || points == nullptr ? 1 : 0;
    for (const int j : members) {
      const bool known = has_colour(rgb.data()[j]) || points == nullptr;
      const Lab l = lab.at(j);
      place(j, p);
      const double x[6] = {static_cast<double>(l.L),
                           static_cast<double>(l.a),
                           static_cast<double>(l.b),
                           p[0],
                           p[1],
                           p[2]};
      for (int k = 0; k < 3 && known; ++k) m[k] += x[k] / coloured;
      for (int k = 3; k < 6; ++k) m[k] += x[k] / static_cast<double>(members.size());
    }
    const Lab l = lab.at(i);
    place(i, p);
    const bool known = coloured > 0 && (has_colour(rgb.data()[i]) || points == nullptr);
    const double colour =
        known ? std::hypot(static_cast<double>(l.L) - m[0], static_cast<double>(l.a) - m[1],
                           static_cast<double>(l.b) - m[2])
              : 0;
    const double g = static_cast<double>(points != nullptr ? c.g_mm : c.g_px);
    return colour +
           static_cast<double>(c.m) / g * std::hypot(p[0] - m[3], p[1] - m[4], p[2] - m[5]);
  }
  std::set<int> border(const std::set<int>& members) const {
    std::set<int> out;
    const int w = lab.width(), n = w * lab.height();
    for (const int i : members) {
      for (const int j : {i - w, i + w, i % w > 0 ? i - 1 : -1, i % w < w - 1 ? i + 1 : -1}) {
        if (j < 0 || j >= n || members.count(j) > 0) continue;
        if (points == nullptr || points->z_mm()[j] > 0) out.insert(j);
      }
    }
    return out;
  }
};

class Grow : public ::testing::TestWithParam<bool> {};

TEST_P(Grow, JoinsTheNearestWithinTheThresholdAndLeavesNoneOut) {
  const bool with_depth = GetParam();
  const std::uint64_t seed = 4711;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed, with_depth ? 1 : 0);
  double same_order = 0, all = 0;
  for (int round = 0; round < 12; ++round) {
    const int w = 14, h = 11;
    const Scene s = random_scene(random, w, h, round % 3 == 0 ? 0 : 0.4);
    LabImage lab(w, h);
    PointImage points(w, h);
    lab.set(s.rgb.view());
    points.set(s.depth.view(), s.k, 1);
    RegionGrower grower(w, h);
    GrowConfig c;
    c.threshold = c.threshold_flat = static_cast<float>(random.uniform(8, 30));
    c.g_px = 6;
    const int start = static_cast<int>(random.integer(0, w * h - 1));
    const PointImage* p = with_depth ? &points : nullptr;
    const int n = grower.grow(lab, p, start, c);
    const Slow slow{s.rgb, lab,   p,
                    c,     start, with_depth ? nearest_reading(points.z_mm(), w, h, start) : start};
    ASSERT_GT(n, 0);
    ASSERT_EQ(grower.members()[0], start);
    std::set<int> region{start};
    for (int k = 1; k < n; ++k) {
      const int i = grower.members()[static_cast<std::size_t>(k)];
      const auto border = slow.border(region);
      ASSERT_TRUE(border.count(i)) << "round " << round;
      const double d = slow.distance(i, region);
      ASSERT_LE(d, static_cast<double>(c.threshold) + 1e-3);
      ASSERT_NEAR(d, static_cast<double>(grower.distances()[static_cast<std::size_t>(k)]), 1e-2);
      double nearest = 1e9;
      for (const int j : border) nearest = std::min(nearest, slow.distance(j, region));
      same_order += d <= nearest + 0.05 * static_cast<double>(c.threshold) ? 1 : 0;
      all += 1;
      region.insert(i);
    }
    for (const int j : slow.border(region)) {
      EXPECT_GT(slow.distance(j, region), static_cast<double>(c.threshold) - 1e-3);
    }
  }
  EXPECT_GT(same_order / std::max(1.0, all), 0.95);  // waiting values age a little between updates
}
INSTANTIATE_TEST_SUITE_P(Flat, Grow, ::testing::Values(false));
INSTANTIATE_TEST_SUITE_P(Depth, Grow, ::testing::Values(true));

TEST(GrowEdges, NoReadingAnywhereIsRefusedAndAHoleTakesTheNearest) {
  const int w = 9, h = 7;
  Image<Rgb> rgb(w, h, {80, 90, 100});
  Image<std::uint16_t> depth(w, h, 0);
  LabImage lab(w, h);
  PointImage points(w, h);
  lab.set(rgb.view());
  points.set(depth.view(), {50, 50, 4, 3, w, h}, 1);
  RegionGrower grower(w, h);
  EXPECT_EQ(grower.grow(lab, &points, 20, {}), 0);
  depth.at(8, 6) = 900;
  depth.at(7, 6) = 65535;
  points.set(depth.view(), {50, 50, 4, 3, w, h}, 1);
  EXPECT_EQ(nearest_reading(points.z_mm(), w, h, 20), 6 * w + 8);
  EXPECT_EQ(grower.grow(lab, &points, 20, {}), 1);
}

}  // namespace
