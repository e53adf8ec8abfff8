// The four measures against their definitions, written out pair by pair and pixel by pixel.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "perception/segmentation/measures.hpp"
#include "rt/random.hpp"

namespace {

using perception::Image;
using perception::LabelView;
using Labels = Image<std::uint16_t>;

int pick(rt::Random& random, int n) { return static_cast<int>(random.integer(0, n - 1)); }

Labels random_labels(rt::Random& random, int w, int h, int names) {
  Labels l(w, h);
  // Blocks rather than noise, so that there are inner pixels and boundaries.
  const int cell = 1 + pick(random, 4);
  std::vector<std::uint16_t> grid(static_cast<std::size_t>(w * h));
  for (auto& g : grid) g = static_cast<std::uint16_t>(1 + 37 * pick(random, names));
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u)
      l.at(u, v) = grid[static_cast<std::size_t>(v / cell * w + u / cell)];
  }
  return l;
}

double brute_pri(const Labels& a, const Labels& b) {
  const int n = a.width() * a.height();
  double alike = 0, all = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) {
      alike += (a.data()[i] == a.data()[j]) == (b.data()[i] == b.data()[j]) ? 1 : 0;
      all += 1;
    }
  }
  return alike / all;
}

double brute_voi(const Labels& a, const Labels& b) {
  const int n = a.width() * a.height();
  std::map<int, double> pa, pb;
  std::map<std::pair<int, int>, double> pab;
  for (int i = 0; i < n; ++i) {
    pa[a.data()[i]] += 1.0 / n;
    pb[b.data()[i]] += 1.0 / n;
    pab[{a.data()[i], b.data()[i]}] += 1.0 / n;
  }
  double ha = 0, hb = 0, mutual = 0;
  for (auto [k, p] : pa) ha -= p * std::log2(p);
  for (auto [k, p] : pb) hb -= p * std::log2(p);
  for (auto [k, p] : pab) mutual += p * std::log2(p / pa[k.first] / pb[k.second]);
  return ha + hb - 2 * mutual;
}

double brute_gce(const Labels& a, const Labels& b) {
  const int n = a.width() * a.height();
  const auto direction = [&](const Labels& p, const Labels& q) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
      double in_p = 0, without_q = 0;
      for (int j = 0; j < n; ++j) {
        if (p.data()[j] != p.data()[i]) continue;
        in_p += 1;
        without_q += q.data()[j] != q.data()[i] ? 1 : 0;
      }
      sum += without_q / in_p;
    }
    return sum / n;
  };
  return std::min(direction(a, b), direction(b, a));
}

double brute_bde(const Labels& a, const Labels& b) {
  const int w = a.width(), h = a.height();
  const auto boundary = [&](const Labels& l) {
    std::vector<std::pair<int, int>> p, rim;
    for (int v = 0; v < h; ++v) {
      for (int u = 0; u < w; ++u) {
        const int u0 = u > 0 ? u - 1 : u, u1 = u < w - 1 ? u + 1 : u;
        const int v0 = v > 0 ? v - 1 : v, v1 = v < h - 1 ? v + 1 : v;
        if (l.at(u0, v) != l.at(u1, v) || l.at(u, v0) != l.at(u, v1)) p.emplace_back(u, v);
        if (u == 0 || v == 0 || u == w - 1 || v == h - 1) rim.emplace_back(u, v);
      }
    }
    return p.empty() ? rim : p;
  };
  const auto directed = [](const auto& from, const auto& to) {
    double sum = 0;
    for (auto [u, v] : from) {
      double best = 1e30;
      for (auto [x, y] : to) best = std::min(best, std::hypot(u - x, v - y));
      sum += best;
    }
    return sum / static_cast<double>(from.size());
  };
  const auto pa = boundary(a), pb = boundary(b);
  return 0.5 * (directed(pa, pb) + directed(pb, pa));
}

TEST(Measures, EqualBruteForceOnRandomMaps) {
  const std::uint64_t seed = 20251;
  RecordProperty("seed", std::to_string(seed));
  rt::Random random(seed);
  for (int round = 0; round < 60; ++round) {
    const int w = 1 + pick(random, 17), h = 2 + pick(random, 14);
    const Labels a = random_labels(random, w, h, 1 + pick(random, 6));
    const Labels b = random_labels(random, w, h, 1 + pick(random, 6));
    const auto s = compare(perception::ScoredMap(a.view()), perception::ScoredMap(b.view()));
    ASSERT_NEAR(s.pri, brute_pri(a, b), 1e-12) << "seed " << seed << " round " << round;
    ASSERT_NEAR(s.voi_bits, brute_voi(a, b), 1e-9) << "seed " << seed << " round " << round;
    ASSERT_NEAR(s.gce, brute_gce(a, b), 1e-12) << "seed " << seed << " round " << round;
    ASSERT_NEAR(s.bde_px, brute_bde(a, b), 1e-5) << "seed " << seed << " round " << round;
  }
}

TEST(Measures, KnownValues) {
  Labels one(8, 8, 7), halves(8, 8, 1);
  for (int v = 0; v < 8; ++v) {
    for (int u = 4; u < 8; ++u) halves.at(u, v) = 2;
  }
  const perception::ScoredMap o(one.view()), h(halves.view());
  const auto same = compare(h, h);
  EXPECT_DOUBLE_EQ(same.pri, 1);
  EXPECT_DOUBLE_EQ(same.voi_bits, 0);
  EXPECT_DOUBLE_EQ(same.gce, 0);
  EXPECT_DOUBLE_EQ(same.bde_px, 0);
  const auto s = compare(o, h);
  EXPECT_DOUBLE_EQ(s.pri, 1 - 32.0 * 32 / (64 * 63 / 2));  // pairs across the halves
  EXPECT_DOUBLE_EQ(s.voi_bits, 1);                         // which half: one bit
  EXPECT_DOUBLE_EQ(s.gce, 0);                              // one refines the other
  // Boundary of the halves: columns 3 and 4; of the single region: the rim of 28 pixels.
  EXPECT_NEAR(s.bde_px, 0.5 * ((2 * 8 * 3 + 2 * 6) / 28.0 + 2 * 12 / 16.0), 1e-6);
  // Symmetric, and blind to names.
  const auto t = compare(h, o);
  EXPECT_DOUBLE_EQ(s.bde_px, t.bde_px);
  EXPECT_DOUBLE_EQ(s.gce, t.gce);
  for (int i = 0; i < 64; ++i) halves.data()[i] = halves.data()[i] == 1 ? 900 : 3;
  EXPECT_DOUBLE_EQ(compare(o, perception::ScoredMap(halves.view())).pri, s.pri);
}

TEST(Measures, SizesMustAgree) {
  const Labels a(3, 4, 1), b(4, 3, 1);
  EXPECT_THROW(
      static_cast<void>(compare(perception::ScoredMap(a.view()), perception::ScoredMap(b.view()))),
      std::invalid_argument);
}

TEST(Measures, RegionRatioIsGeometricAgainstTheMedian) {
  perception::RegionRatio r;
  r.add(20, {3, 10, 40});     // 2
  r.add(5, {4, 100, 16, 2});  // 0.5: the median of four lies between the middle two
  EXPECT_NEAR(r.value(), 1.0, 1e-12);
  r.add(8, {1});
  EXPECT_NEAR(r.value(), 2.0, 1e-12);
}

}  // namespace
