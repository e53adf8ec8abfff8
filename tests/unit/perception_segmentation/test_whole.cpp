// Colour, superpixels, whole-image segmentation.
#include <gtest/gtest.h>

#include <cmath>

#include "perception/segmentation/lab.hpp"
#include "perception/segmentation/measures.hpp"
#include "perception/segmentation/region_merge.hpp"
#include "rt/random.hpp"

namespace {

using namespace perception;

TEST(Lab, KnownColoursAndTablesAgainstTheFormulas) {
  const Lab white = lab_of({255, 255, 255}), red = lab_of({255, 0, 0});
  EXPECT_NEAR(white.L, 100, 0.01);
  EXPECT_NEAR(white.a, 0, 0.02);
  EXPECT_NEAR(red.L, 53.24, 0.02);
  EXPECT_NEAR(red.a, 80.09, 0.05);
  EXPECT_NEAR(red.b, 67.20, 0.05);
  rt::Random random(3);
  Image<Rgb> image(256, 128);
  for (int i = 0; i < 256 * 128; ++i) {
    const auto x = random();
    const unsigned mask = i % 3 == 0 ? 15 : 255;  // dark colours, where the curve bends most
    image.data()[i] = {static_cast<std::uint8_t>(x & mask),
                       static_cast<std::uint8_t>(x >> 8 & mask),
                       static_cast<std::uint8_t>(x >> 16 & mask)};
  }
  LabImage lab(256, 128);
  lab.set(image.view());
  double worst = 0;
  for (int i = 0; i < 256 * 128; ++i) {
    const Lab a = lab.at(i), b = lab_of(image.data()[i]);
    worst = std::max({worst, std::abs(static_cast<double>(a.L - b.L)),
                      std::abs(static_cast<double>(a.a - b.a)),
                      std::abs(static_cast<double>(a.b - b.b))});
  }
  EXPECT_LT(worst, 0.15);
  std::printf("largest error of the tables: %.4f Lab units\n", worst);
}

// Random straight-edged colour fields with noise; returns the truth.
Image<std::uint16_t> paint(rt::Random& random, Image<Rgb>& image, int fields, int noise) {
  const int w = image.width(), h = image.height();
  Image<std::uint16_t> truth(w, h);
  std::vector<std::pair<int, int>> centre;
  std::vector<Rgb> colour;
  for (int k = 0; k < fields; ++k) {
    centre.emplace_back(random.integer(0, w - 1), random.integer(0, h - 1));
    colour.push_back({static_cast<std::uint8_t>(30 + 190 * (k & 1)),
                      static_cast<std::uint8_t>(30 + 190 * (k >> 1 & 1)),
                      static_cast<std::uint8_t>(30 + 190 * (k >> 2 & 1))});
  }
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      int best = 0;
      double least = 1e9;
      for (int k = 0; k < fields; ++k) {
        const double d = std::hypot(u - centre[static_cast<std::size_t>(k)].first,
                                    v - centre[static_cast<std::size_t>(k)].second);
        if (d < least) least = d, best = k;
      }
      truth.at(u, v) = static_cast<std::uint16_t>(best);
      const Rgb c = colour[static_cast<std::size_t>(best)];
      const auto n = [&](int x) {
        return static_cast<std::uint8_t>(x + random.integer(-noise, noise));
      };
      image.at(u, v) = {n(c.r), n(c.g), n(c.b)};
    }
  }
  return truth;
}

int components(const std::vector<std::uint16_t>& labels, int w, int h) {
  std::vector<std::uint8_t> seen(labels.size(), 0);
  std::vector<int> stack;
  int n = 0;
  for (int first = 0; first < w * h; ++first) {
    if (seen[static_cast<std::size_t>(first)]) continue;
    ++n;
    stack.push_back(first);
    seen[static_cast<std::size_t>(first)] = 1;
    while (!stack.empty()) {
      const int i = stack.back();
      stack.pop_back();
      for (const int j : {i - w, i + w, i % w > 0 ? i - 1 : -1, i % w < w - 1 ? i + 1 : -1}) {
        if (j < 0 || j >= w * h || seen[static_cast<std::size_t>(j)]) continue;
        if (labels[static_cast<std::size_t>(j)] != labels[static_cast<std::size_t>(i)]) continue;
        seen[static_cast<std::size_t>(j)] = 1;
        stack.push_back(j);
      }
    }
  }
  return n;
}

TEST(Superpixels, ConnectedNumberedInOrderAndTrueToEdges) {
  rt::Random random(11);
  for (int round = 0; round < 6; ++round) {
    const int w = 60 + 17 * round, h = 50 + 9 * round;
    Image<Rgb> image(w, h);
    const auto truth = paint(random, image, 5, 4);
    LabImage lab(w, h);
    lab.set(image.view());
    Superpixels s(w, h);
    const float* const planes[] = {lab.plane(0), lab.plane(1), lab.plane(2)};
    s.run(planes, w, h, {});
    std::vector<std::uint16_t> labels(static_cast<std::size_t>(w * h));
    int next = 0, astray = 0;
    for (int i = 0; i < w * h; ++i) {
      const int l = s.labels()[static_cast<std::size_t>(i)];
      labels[static_cast<std::size_t>(i)] = static_cast<std::uint16_t>(l);
      ASSERT_LE(l, next);
      if (l == next) ++next;
    }
    EXPECT_EQ(next, s.count());
    EXPECT_EQ(components(labels, w, h), s.count());
    // Pixels that are not of the field most of their superpixel is of.
    std::vector<std::vector<int>> votes(static_cast<std::size_t>(s.count()),
                                        std::vector<int>(5, 0));
    for (int i = 0; i < w * h; ++i) ++votes[labels[static_cast<std::size_t>(i)]][truth.data()[i]];
    for (const auto& v : votes) {
      int sum = 0, most = 0;
      for (const int x : v) sum += x, most = std::max(most, x);
      astray += sum - most;
    }
    EXPECT_LT(astray, 0.02 * w * h);
    Superpixels again(w + 5, h + 3);
    again.run(planes, w, h, {});
    EXPECT_TRUE(std::equal(s.labels().begin(), s.labels().begin() + w * h, again.labels().begin()));
  }
}

TEST(WholeImage, FindsFieldsAndEachLabelIsOnePiece) {
  rt::Random random(5);
  for (int round = 0; round < 4; ++round) {
    Image<Rgb> image(180, 140);
    const auto truth = paint(random, image, 6, 15);
    const WholeImage out = segment_whole(image.view(), {});
    const LabelView view{out.labels.data(), 180, 140, 180};
    const auto s = compare(ScoredMap(view), ScoredMap(truth.view()));
    EXPECT_GT(s.pri, 0.97) << round;
    EXPECT_LT(s.voi_bits, 0.6) << round;
    EXPECT_EQ(components(out.labels, 180, 140), out.regions);
    EXPECT_EQ(ScoredMap(view).regions(), out.regions);
    EXPECT_EQ(segment_whole(image.view(), {}).labels, out.labels);
  }
}

TEST(WholeImage, SmallAndEvenImages) {
  for (const auto& [w, h] : {std::pair{2, 2}, {1, 40}, {40, 1}, {9, 9}, {64, 48}}) {
    const Image<Rgb> image(w, h, {100, 120, 140});
    const WholeImage out = segment_whole(image.view(), {});
    EXPECT_EQ(out.labels.size(), static_cast<std::size_t>(w * h));
    EXPECT_EQ(out.regions, 1);
    EXPECT_EQ(components(out.labels, w, h), out.regions);
  }
}

// Few things in sight are few regions: plain ground, two halves, a disc on plain ground; even and
// with noise.
TEST(WholeImage, FewThingsAreFewRegions) {
  constexpr int kWidth = 320, kHeight = 240;
  const auto inside = [](int what, int x, int y) {
    if (what == 0) return false;
    if (what == 1) return x < kWidth / 2;
    return (x - 150) * (x - 150) + (y - 120) * (y - 120) < 70 * 70;
  };
  rt::Random random(3);
  for (int what = 0; what < 3; ++what) {
    for (const double noise : {0.0, 4.0}) {
      Image<Rgb> image(kWidth, kHeight);
      int apart = 0;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          const double by = noise * (2 * random.uniform() - 1);
          const auto c = [by](double v) { return static_cast<std::uint8_t>(v + by); };
          image.at(x, y) =
              inside(what, x, y) ? Rgb{c(190), c(60), c(50)} : Rgb{c(70), c(90), c(170)};
        }
      }
      const WholeImage out = segment_whole(image.view(), {});
      for (int i = 0; i < kWidth * kHeight; ++i) {
        const int corner = inside(what, i % kWidth, i / kWidth) ? 120 * kWidth + 150 : kWidth - 1;
        apart +=
            out.labels[static_cast<std::size_t>(i)] != out.labels[static_cast<std::size_t>(corner)]
                ? 1
                : 0;
      }
      std::printf("  %s, noise %.0f: %d regions, %.2f %% of the pixels astray\n",
                  what == 0   ? "plain"
                  : what == 1 ? "halves"
                              : "disc",
                  noise, out.regions, 100.0 * apart / (kWidth * kHeight));
      // Noise makes a narrow ring along the disc a region or two of its own.
      EXPECT_LE(out.regions, what == 0 ? 1 : noise > 0 && what == 2 ? 6 : 2);
      EXPECT_LT(apart, kWidth * kHeight / 50);
    }
  }
}

}  // namespace
